"""Generators of scenes from a seed: furnished rooms of any difficulty, and worlds like BARN, CrowdNav and DynaBARN."""
