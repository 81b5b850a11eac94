"""Where pixels look: pinhole, field curvature, walls; the one place where pixels become rays."""
