"""Records: `dataclass` as in the standard library, but quicker to import; and fields that options set.

Until Python 3.13 the library compiles up to six functions for every class when its module is imported. That is a tenth
or more of the time of a run of one frame. The `dataclass` of this module compiles no function: all classes share the
same ones. It describes fields as the library does, without the checks that the library makes of them. Modules that every
run loads take it from here. Code that reads or uses a record sees no difference.
"""

import sys
from dataclasses import field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or sys.version_info >= (3, 13):
    from dataclasses import dataclass
else:
    import dataclasses
    import inspect
    from copy import copy
    from dataclasses import MISSING, Field
    from operator import attrgetter
    from typing import ClassVar

    def dataclass(cls=None, /, *, frozen=False, eq=True, slots=False, kw_only=False):
        """Return a class, or the decorator that makes it, as `dataclasses.dataclass` does."""
        if slots:
            return dataclasses.dataclass(cls, frozen=frozen, eq=eq, slots=True, kw_only=kw_only)
        return (lambda one: _record(one, frozen, eq, kw_only)) if cls is None else _record(cls, frozen, eq, kw_only)

    def _record(cls, frozen, eq, kw_only):
        own = dict(vars(cls))
        items = _fields(cls, own, kw_only)
        given_to_init = [item for item in items.values() if item.init]
        cls.__dataclass_fields__ = items
        cls._init_fields = tuple((item.name, item.default, item.default_factory) for item in given_to_init)
        cls._names = tuple(item.name for item in given_to_init)
        cls._positional = cls.__match_args__ = tuple(item.name for item in given_to_init if not item.kw_only)
        cls._checks = hasattr(cls, "__post_init__")
        shared = {"__init__": _init, "__signature__": _Signature(), "__repr__": _repr}
        if frozen:
            shared |= {"__setattr__": _refuse_change, "__delattr__": _refuse_change}
        if eq:
            names = [item.name for item in items.values() if item.compare]
            cls._compared = staticmethod(attrgetter(*names) if names else lambda _: ())
            shared |= {"__eq__": _is_equal, "__hash__": _hash if frozen else None}
        for name in shared.keys() - own.keys():
            setattr(cls, name, shared[name])
        return cls

    def _fields(cls, own, kw_only):
        """Return the fields of a class by name, those of its bases first. What the class holds in their place is then only
        their defaults."""
        items = {}
        for base in cls.__mro__[:0:-1]:
            items |= vars(base).get("__dataclass_fields__", {})
        for name, kind in own.get("__annotations__", {}).items():
            if getattr(kind, "__origin__", None) is ClassVar:
                continue
            item = own.get(name, MISSING)
            if not isinstance(item, Field):
                item = field(default=item)
            elif item.default is MISSING:
                delattr(cls, name)
            else:
                setattr(cls, name, item.default)
            if item.kw_only is MISSING:
                item.kw_only = kw_only
            item.name, item.type, item._field_type = name, kind, dataclasses._FIELD
            items[name] = item
        return items

    def _init(self, /, *values, **named):
        kind = type(self)
        if named or not len(values) == len(kind._positional) == len(kind._names):
            values = _values(kind, values, named)
        # the common case needs no look at names: all values are given, in order
        self.__dict__.update(zip(kind._names, values, strict=True))
        if kind._checks:
            self.__post_init__()

    def _values(kind, values, named):
        """Return the values of a new record's fields, in the order of the fields."""
        given = dict(zip(kind._positional, values, strict=False), **named)
        found, unknown = [], len(values) + len(named)
        for name, default, make in kind._init_fields:
            if name in given:
                found.append(given[name])
                unknown -= 1
            elif default is not MISSING:
                found.append(default)
            elif make is not MISSING:
                found.append(make())
            else:
                break
        if unknown or len(found) < len(kind._init_fields):
            # the library's class raises the TypeError that says what is wrong
            _of_the_library(kind)(*values, **named)
        return found

    def _of_the_library(kind):
        """Return a class of the standard library with the same fields, for what is seldom needed: signatures and error
        messages."""
        items = [(item.name, item.type, copy(item)) for item in dataclasses.fields(kind)]
        return dataclasses.make_dataclass(kind.__qualname__, items)

    class _Signature:
        def __get__(self, _one, kind):
            return inspect.signature(_of_the_library(kind))

    def _refuse_change(self, name, *_value):
        raise dataclasses.FrozenInstanceError(f"cannot change field {name!r}")

    def _repr(self):
        shown = (f"{item.name}={getattr(self, item.name)!r}" for item in dataclasses.fields(self) if item.repr)
        return f"{type(self).__qualname__}({', '.join(shown)})"

    def _is_equal(self, other):
        if self is other:
            return True
        if other.__class__ is not self.__class__:
            return NotImplemented
        return self._compared(self) == other._compared(other)

    def _hash(self):
        return hash(self._compared(self))


def setting(default: Any, help: str, /, **option: Any) -> Any:
    """Declare a field of a settings record that an option sets: its default, its help text, and further parts of the option.

    The further parts are keywords of `commands/options.py: setting_option`.
    """
    return field(default=default, metadata={"help": help, **option})


__all__ = ["dataclass", "setting"]
