"""Person detection scored against ground truth, by distance band."""
