"""Studies: many trials, their store and statistics, experiments against goals, and the report of the paper."""
