"""Which sensor is lying: residuals of an identified machine, tested while it works."""
