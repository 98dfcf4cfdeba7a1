"""The 3D scene."""
