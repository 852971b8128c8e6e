"""Parameters as the robot's other processes see them."""

from __future__ import annotations

from robotctl.mavlink.parameters.parameter import Change
from robotctl.mavlink.parameters.parameter_set import ParameterSet
from robotctl.messages.tuning import ParameterFacts, ParameterTable, ParameterValues


def table_of(parameters: ParameterSet, now_ns: int) -> ParameterTable:
    """Return what the parameters are."""
    facts = tuple(
        ParameterFacts(
            parameter.name,
            parameter.key,
            default,
            float(parameter.low),
            float(parameter.high),
            unit,
            description,
            parameter.change.value,
            parameter.change is Change.NEVER,
            not isinstance(default, float),
        )
        for parameter, default, unit, description in parameters.facts()
    )
    return ParameterTable(now_ns, facts)


def values_of(parameters: ParameterSet, now_ns: int) -> ParameterValues:
    """Return the values that are wanted, and those in force."""
    known = parameters.parameters
    wanted = tuple(parameters.value(each) for each in known)
    return ParameterValues(now_ns, wanted, tuple(parameters.in_force(each) for each in known))
