"""Pictures and plots; the only place that imports matplotlib."""

import os

# no window is opened, and a name that matplotlib does not know would end its import
os.environ["MPLBACKEND"] = "agg"
