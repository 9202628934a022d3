"""Clock, errors, messages, YAML and paths: what every other package builds on."""
