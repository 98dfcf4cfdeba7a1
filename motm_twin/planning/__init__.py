"""PathRTR, Bezier heuristic, global path, local plan and base placement."""
