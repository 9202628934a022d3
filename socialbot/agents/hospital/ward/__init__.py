"""The ward of the hospital: as it is built, as it really is, what goes wrong in it, and how it is drawn."""
