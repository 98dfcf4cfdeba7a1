"""Robots that live in another program: their keys and messages, a plant that drives one, and a reference robot."""
