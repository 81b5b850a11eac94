"""Scenes: geometry, light, camera, recorder."""
