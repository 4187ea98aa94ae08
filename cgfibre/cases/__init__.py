"""Experiments with a closed form beside them, through the package's own decks: what verification, stability maps and
charts share."""
