"""Surfaces of bodies as files that other programs read."""
