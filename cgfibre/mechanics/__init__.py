"""Closed forms with their sources: rods, contact, supports. No files, no engine."""
