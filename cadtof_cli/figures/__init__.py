"""Pictures and plots; the only place that imports matplotlib."""
