"""Records: `dataclass` as the standard library has it, but for the time that it takes before anything is done.

Until Python 3.13 the library compiles up to six functions for every class when its module is imported, a tenth of the time of a
run of one frame. Here one is compiled, for classes that make many records; what is the same for all classes is written once.
Modules that every run loads take theirs from here, and nobody who reads or uses a record sees a difference.
"""

import sys
from dataclasses import field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or sys.version_info >= (3, 13):
    from dataclasses import dataclass
else:
    import dataclasses
    from functools import partial
    from operator import attrgetter

    FEW = 20
    """Records that a class makes before it is worth compiling how: of most there are not as many in a run."""

    def dataclass(cls=None, /, *, frozen=False, eq=True, slots=False, **options):
        """Return a class, or what makes one, as `dataclasses.dataclass` does."""
        if slots:
            return dataclasses.dataclass(cls, frozen=frozen, eq=eq, slots=slots, **options)
        return (lambda one: _record(one, frozen, eq, options)) if cls is None else _record(cls, frozen, eq, options)

    def _record(cls, frozen, eq, options):
        own = set(vars(cls))
        cls = dataclasses.dataclass(cls, init=False, eq=False, repr=False, **options)
        cls.__init__ = _Init(cls)
        shared = {"__repr__": _told} | ({"__setattr__": _refuse, "__delattr__": _keep} if frozen else {})
        if eq:
            names = [item.name for item in dataclasses.fields(cls) if item.compare]
            cls._compared = staticmethod(attrgetter(*names) if names else lambda _: ())
            shared |= {"__eq__": _is_equal, "__hash__": _hash if frozen else None}
        for name in shared.keys() - own:
            setattr(cls, name, shared[name])
        return cls

    class _Init:
        """`__init__` of the first records of a class; for more of them, and for who looks at it, one is compiled in its place."""

        def __init__(self, cls):
            self._cls, self._left = cls, FEW

        def __get__(self, one, owner=None):
            if one is not None and self._left:
                self._left -= 1
                return partial(self._fill, one)
            self._cls.__init__ = init = _compiled_init(self._cls)
            return init.__get__(one, owner)

        def _fill(self, one, /, *places, **names):
            items = [item for item in dataclasses.fields(self._cls) if item.init or _is_made(item)]
            given = (
                dict(zip((item.name for item in items if item.init and not item.kw_only), places, strict=False)) | names
            )
            count = len(given)
            values = {
                item.name: given.pop(item.name) if item.init and item.name in given else _default(item)
                for item in items
            }
            if (
                given
                or count < len(places) + len(names)
                or any(value is dataclasses.MISSING for value in values.values())
            ):
                # it says what is wrong
                _compiled_init(self._cls)(one, *places, **names)
            for name, value in values.items():
                object.__setattr__(one, name, value)
            if hasattr(one, "__post_init__"):
                one.__post_init__()

    def _is_made(item):
        return item.default_factory is not dataclasses.MISSING

    def _default(item):
        return item.default_factory() if _is_made(item) else item.default

    class _Made:
        """The default of a field that a factory makes, as the library shows it."""

        def __repr__(self):
            return "<factory>"

    def _compiled_init(cls):
        known = {"_set": object.__setattr__, "_made": _Made()}
        places, names, lines = ["self"], [], []
        for item in dataclasses.fields(cls):
            name, value = item.name, item.name
            parameter, known[f"_type_{name}"] = f"{name}: _type_{name}", item.type
            if item.default is not dataclasses.MISSING:
                parameter, known[f"_default_{name}"] = f"{parameter} = _default_{name}", item.default
            elif _is_made(item):
                parameter, known[f"_make_{name}"] = f"{parameter} = _made", item.default_factory
                value = f"_make_{name}() if {name} is _made else {name}" if item.init else f"_make_{name}()"
            if item.init:
                (names if item.kw_only else places).append(parameter)
            if item.init or _is_made(item):
                lines.append(f"_set(self, {name!r}, {value})")
        lines.append("self.__post_init__()" if hasattr(cls, "__post_init__") else "pass")
        parameters = ", ".join([*places, *(["*"] if names else []), *names])
        exec(f"def __init__({parameters}) -> None:\n  " + "\n  ".join(lines), known)
        init = known["__init__"]
        init.__qualname__, init.__module__ = f"{cls.__qualname__}.__init__", cls.__module__
        return init

    def _refuse(self, name, value):
        raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")

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
