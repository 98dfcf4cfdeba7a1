"""Figures, tables and the report of `motm-twin paper`."""
