"""Pictures and plots; the only place that imports matplotlib."""

import os

# "agg" opens no window. It replaces the user's value, because importing matplotlib fails if it does not know the name
os.environ["MPLBACKEND"] = "agg"
