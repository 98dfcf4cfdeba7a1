"""Robots in another program: a plant that drives one, and a reference robot."""
