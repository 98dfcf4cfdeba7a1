"""Sessions: what repeats a run bit for bit, and going back in a run."""
