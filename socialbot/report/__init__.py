"""What deliberating agents did in a run, told to people: sentences, a chart of all plans, a page."""
