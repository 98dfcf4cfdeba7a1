"""Generators of scenes from a seed: furnished rooms of any difficulty, and worlds like those of the BARN challenge."""
