"""How docstrings are read for the reference."""

import re

import griffe

ARRAY = re.compile(r"^(\s*(?:[\w, ]+ : )?[\w ]+), shape (\(.*\))(?=(?:, optional)?$)", re.MULTILINE)


class Shapes(griffe.Extension):
    """Keep ``ndarray, shape (n,)`` as it is written; read as Python it would be a call."""

    def on_object(self, *, obj: griffe.Object, **_: object) -> None:
        """Write the type of an array in words that are no Python."""
        if obj.docstring is not None:
            obj.docstring.value = ARRAY.sub(r"\1 of shape \2", obj.docstring.value)
