"""A vehicle from measurements: fitted, validated, sized, and its tyres."""
