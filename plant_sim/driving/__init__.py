"""Road, path, driver, manoeuvres, and the standards that judge them."""
