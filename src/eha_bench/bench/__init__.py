"""Running suites: trials on a target become recordings, recordings become scores and a result."""
