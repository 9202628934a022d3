"""How well people are seen: detectors and tracking judged by ground truth, beside the figures of the paper."""
