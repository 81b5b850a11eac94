"""Scenes: geometry, light, camera."""
