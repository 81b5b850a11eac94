"""Records: `dataclass` as the standard library has it, but for the time that it takes before anything is done.

Until Python 3.13 the library compiles six functions for every frozen class when its module is imported, a tenth of the time of a
run of one frame. Here it compiles one; what is the same for all classes is written once. Modules that every run loads take theirs
from here, and nobody who reads or uses a record sees a difference.
"""

import sys
from dataclasses import field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or sys.version_info >= (3, 13):
    from dataclasses import dataclass
else:
    import dataclasses
    from operator import attrgetter

    def dataclass(cls=None, /, *, frozen=False, eq=True, slots=False, **options):
        """Return a class, or what makes one, as `dataclasses.dataclass` does."""
        if not frozen or slots:
            return dataclasses.dataclass(cls, frozen=frozen, eq=eq, slots=slots, **options)
        return (lambda one: _record(one, eq, options)) if cls is None else _record(cls, eq, options)

    def _record(cls, eq, options):
        own = set(vars(cls))
        cls = dataclasses.dataclass(cls, eq=False, repr=False, **options)
        shared = {"__setattr__": _set_once, "__delattr__": _keep, "__repr__": _told}
        if eq:
            names = [item.name for item in dataclasses.fields(cls) if item.compare]
            cls._compared = staticmethod(attrgetter(*names) if names else lambda _: ())
            shared |= {"__eq__": _is_equal, "__hash__": _hash}
        for name in shared.keys() - own:
            setattr(cls, name, shared[name])
        return cls

    def _set_once(self, name, value):
        if name in self.__dict__ or name not in self.__dataclass_fields__:
            raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")
        self.__dict__[name] = value

    def _keep(self, name):
        raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")

    def _told(self):
        told = (f"{item.name}={getattr(self, item.name)!r}" for item in dataclasses.fields(self) if item.repr)
        return f"{type(self).__qualname__}({', '.join(told)})"

    def _is_equal(self, other):
        if self is other:
            return True
        if other.__class__ is not self.__class__:
            return NotImplemented
        return self._compared(self) == other._compared(other)

    def _hash(self):
        return hash(self._compared(self))


def setting(default: Any, help: str, /, **option: Any) -> Any:
    """Declare a field of a settings record that an option sets: its default, what it does, and what else the option is made of.

    The last are keywords of `commands/options.py: setting_option`.
    """
    return field(default=default, metadata={"help": help, **option})


__all__ = ["dataclass", "setting"]
