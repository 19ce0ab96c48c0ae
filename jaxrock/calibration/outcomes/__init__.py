"""Populations of blocks from tests that overturned or stood, and scores of their predictions."""
