"""What `scripts/check_docs` holds the documentation against."""
