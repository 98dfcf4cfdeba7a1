"""Sessions, which repeat a run bit for bit, and branches, which go back in a run."""
