"""Tables of a scene with keys changed, for the tests of what scenes take."""

import copy

ABSENT = object()


def with_changes(base, changes):
    """``base`` with dotted keys set, or taken out (ABSENT)."""
    data = copy.deepcopy(base)
    for key, value in changes.items():
        *parents, last = key.split(".")
        table = data
        for parent in parents:
            table = table.setdefault(parent, {})
        if value is ABSENT:
            table.pop(last, None)
        else:
            table[last] = value
    return data
