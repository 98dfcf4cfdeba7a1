"""Figures, tables and the report of `motm-twin paper`: one file per figure or table."""
