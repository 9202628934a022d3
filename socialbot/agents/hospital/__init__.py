"""The hospital: robots patrol and disinfect rooms, with nurses who let them and tidy up."""
