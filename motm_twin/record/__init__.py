"""Recordings: written, read, replayed, computed again and compared; and what-if runs of a session."""
