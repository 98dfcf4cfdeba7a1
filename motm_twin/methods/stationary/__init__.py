"""Stop, then manipulate: base poses by an inverse reachability map, and a base that stands while the arm works."""
