"""Clock, errors, messages, YAML and paths: the base of all other packages."""
