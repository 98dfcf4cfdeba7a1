"""Zenoh: keys, messages, the twin server and its client."""
