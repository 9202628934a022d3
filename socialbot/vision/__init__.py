"""From pictures to people: image conversion, person detection, distance."""
