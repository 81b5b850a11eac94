"""From README, docs and the commands' help to the pages of the site: see `scripts/docs`."""
