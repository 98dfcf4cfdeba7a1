"""From scans to an occupancy grid, distances, proximity cost and obstacle polygons."""
