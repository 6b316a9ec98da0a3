"""The onlooker: what a bus tells of the roll controller, and a page that shows it live."""
