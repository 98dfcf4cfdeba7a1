"""Experiments: many trials on one machine or a cluster, stored one line each, and what they say together."""
