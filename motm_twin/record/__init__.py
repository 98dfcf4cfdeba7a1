"""Runs that can be repeated: sessions, replay, branches, what-if."""
