"""The Viser page."""
