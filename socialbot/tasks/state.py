"""States: what is so in the world, as state variables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any


class State:
    """State variables as attributes: ``State(loc={"spot1": "room4"})``, then ``state.loc["spot1"]``.

    A variable is a dictionary, list or set, or a plain value. Values inside of those are never changed in place, but
    replaced: copies share them.
    """

    def __init__(self, name: str = "state", **variables: Any) -> None:
        self.__name__ = name
        vars(self).update(variables)

    if TYPE_CHECKING:

        def __setattr__(self, name: str, value: Any) -> None: ...

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"{vars(self).get('__name__')} has no state variable {name!r}")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, State) and self.variables() == other.variables()

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"State({', '.join((repr(self.__name__), *(f'{name}={v!r}' for name, v in self.variables().items())))})"

    def variables(self) -> dict[str, Any]:
        """The state variables by name."""
        return {name: value for name, value in vars(self).items() if name != "__name__"}

    def copy(self) -> State:
        """Another state with the same variables; one can be changed without the other."""
        other = object.__new__(type(self))
        vars(other).update(
            (name, value.copy() if isinstance(value, (dict, list, set)) else value)
            for name, value in vars(self).items()
        )
        return other
