"""Make the pages of the site from README, docs and the commands' help: see `scripts/docs`."""
