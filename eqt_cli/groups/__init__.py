"""Matrix Lie groups: one file per group, found by scanning this folder."""

from eqt_cli.core.errors import ComponentError, suggestion
from eqt_cli.core.registry import Registry
from eqt_cli.groups.base import MatrixLieGroup, Part

groups = Registry("group", __name__, MatrixLieGroup)


def group_named(name: str) -> MatrixLieGroup:
    """Return the group that a configuration calls `name`, perhaps a product.

    Raises
    ------
    ComponentError
        If there is none; the message names the closest group, or else examples.
    """
    for kinds in (groups.own, groups.all):
        if group := next(filter(None, (kind.named(name) for kind in kinds())), None):
            return group
    known = [example for kind in groups.all() for example in kind.examples()]
    simple = [example for example in known if "*" not in example]
    products = [example for example in known if example not in simple]
    listed = ", ".join(simple) + f" and products such as {products[0]}" * bool(products)
    hint = suggestion(name, known) or f"; known: {listed}"
    raise ComponentError(f"unknown group '{name}'{hint}")


__all__ = ["MatrixLieGroup", "Part", "group_named", "groups"]
