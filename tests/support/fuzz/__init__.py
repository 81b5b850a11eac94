"""Hostile input: sound samples of everything that is read, ways to spoil them that know their structure, and who reads them."""
