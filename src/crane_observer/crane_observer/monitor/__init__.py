"""Which sensor is faulty: residuals of an identified machine, tested while it works."""
