"""motm_twin: a web-served digital twin of reactive manipulation on the move."""

__version__ = "0.1.0"
