"""Controllers by name: the paper's, its ablations, and the systems it is compared with, on the same robot."""
