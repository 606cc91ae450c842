"""The families by name, with a model of each one's parameters."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, get_type_hints

from pydantic import BaseModel, create_model

from mpvi_bt.ground.errors import UnknownName
from mpvi_bt.ground.marked_yaml import Record
from mpvi_bt.house.things import festive, fixed_furniture, food, jointed_furniture, lidded, objects, scanned
from mpvi_bt.house.things.description import Description

Family = Callable[..., Description]

FAMILIES: Mapping[str, Family] = {
    name: function
    for module in (objects, festive, food, fixed_furniture, jointed_furniture, lidded, scanned)
    for name, function in inspect.getmembers(module, inspect.isfunction)
    if function.__module__ == module.__name__ and not name.startswith("_")
}


def family(name: str) -> Family:
    """The function of that name.

    Raises:
        UnknownName: There is none.
    """
    if name not in FAMILIES:
        raise UnknownName("family", name, FAMILIES)
    return FAMILIES[name]


@cache
def parameters(name: str) -> type[BaseModel]:
    """A model of the parameters that a family takes, made from its signature; unknown keys are refused.

    Raises:
        UnknownName: There is no such family.
    """
    function = family(name)
    hints = get_type_hints(function, include_extras=True)
    fields: dict[str, Any] = {
        key: (hints[key], ... if parameter.default is parameter.empty else parameter.default)
        for key, parameter in inspect.signature(function).parameters.items()
    }
    return create_model(f"{name}_parameters", __base__=Record, **fields)


def describe(name: str, given: Mapping[str, Any]) -> Description:
    """The description that a family makes of parameters.

    Raises:
        UnknownName: There is no such family.
        pydantic.ValidationError: A parameter is missing, unknown or out of range.
    """
    model = parameters(name).model_validate(dict(given))
    return family(name)(**{key: getattr(model, key) for key in type(model).model_fields})
