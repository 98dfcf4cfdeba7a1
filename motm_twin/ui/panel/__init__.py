"""The panel of a visitor."""
