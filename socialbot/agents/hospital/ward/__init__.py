"""Ward of the hospital: description, simulation, faults and drawing. It does not depend on missions."""
