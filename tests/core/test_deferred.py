"""Dataclasses that are completed when they are first used behave as the standard ones."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import subprocess
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import FrozenInstanceError, InitVar, field
from functools import cached_property
from typing import Any, ClassVar, Generic, TypeVar

import pytest

from ensemble_ctrl.core.deferred import _Deferred, deferred_dataclass

T = TypeVar("T")
Decorator = Callable[..., Any]


def family(decorator: Decorator) -> dict[str, type[Any]]:
    """Classes of all kinds, made by one of the decorators."""

    @decorator(frozen=True)
    class Point:
        """A point."""

        x: float
        y: float = 0.0
        tags: list[str] = field(default_factory=list, compare=False)
        hidden: int = field(default=3, repr=False)
        kind: ClassVar[str] = "point"

        def __post_init__(self) -> None:
            object.__setattr__(self, "x", float(self.x))

        @cached_property
        def norm(self) -> float:
            return abs(self.x) + abs(self.y)

    @decorator(frozen=True)
    class Solid(Point):
        """A point in space."""

        z: float = 1.0

    @decorator(eq=False)
    class Box(Generic[T]):
        """Changes."""

        value: T
        grown: InitVar[int] = 0  # type: ignore[assignment]

        def __post_init__(self, grown: int) -> None:
            self.size = grown

    @decorator()
    class Own:
        """Writes methods of its own."""

        a: int

        def __repr__(self) -> str:
            return "own"

        def __init__(self, b: int) -> None:
            self.a = b + 1

    class Abstract(ABC):
        @abstractmethod
        def area(self) -> float: ...

    @decorator(frozen=True, eq=False)
    class Square(Abstract):
        """A square."""

        side: float

        def area(self) -> float:
            return self.side**2

    class Child(Point):
        """No dataclass itself."""

        def __init__(self, x: float) -> None:
            super().__init__(x, y=2.0)  # type: ignore[call-arg]

    return {"Point": Point, "Solid": Solid, "Box": Box, "Own": Own, "Square": Square, "Child": Child}


OURS, STANDARD = family(deferred_dataclass), family(dataclasses.dataclass)
MAKE = {"Point": (1,), "Solid": (1, 2), "Box": (5, 7), "Own": (4,), "Square": (3.0,), "Child": (1,)}


def text(value: object) -> str:
    """How it prints, without the name of the function that made its class."""
    return repr(value).rpartition("<locals>.")[2].split(" at 0x")[0]


@pytest.mark.parametrize("name", MAKE)
def test_instances_are_the_same(name: str) -> None:
    ours, theirs = OURS[name](*MAKE[name]), STANDARD[name](*MAKE[name])
    assert text(ours) == text(theirs)
    assert vars(ours) == vars(theirs)
    assert (ours == OURS[name](*MAKE[name])) == (theirs == STANDARD[name](*MAKE[name]))
    assert (type(ours).__hash__ is None) == (type(theirs).__hash__ is None)
    assert text(copy.copy(ours)) == text(theirs)


@pytest.mark.parametrize("name", MAKE)
def test_classes_are_the_same(name: str) -> None:
    ours, theirs = family(deferred_dataclass)[name], family(dataclasses.dataclass)[name]
    assert str(inspect.signature(ours)) == str(inspect.signature(theirs))
    assert [each.name for each in dataclasses.fields(ours)] == [each.name for each in dataclasses.fields(theirs)]
    assert ours.__match_args__ == theirs.__match_args__
    assert set(vars(ours)) == set(vars(theirs))
    assert ours.__doc__ == theirs.__doc__
    assert repr(ours.__dataclass_params__) == repr(theirs.__dataclass_params__)


def test_fields_are_seen_before_the_first_instance() -> None:
    fresh = family(deferred_dataclass)
    assert isinstance(vars(fresh["Solid"])["__init__"], _Deferred)
    assert dataclasses.is_dataclass(fresh["Solid"])
    assert fresh["Point"].hidden == 3
    assert not hasattr(fresh["Point"], "tags")


def test_nothing_is_changed_in_a_frozen_one() -> None:
    for made in (family(deferred_dataclass), family(dataclasses.dataclass)):
        point, child = made["Point"](1), made["Child"](1)
        with pytest.raises(FrozenInstanceError, match="cannot assign to field 'x'"):
            point.x = 2
        with pytest.raises(FrozenInstanceError, match="cannot assign to field 'new'"):
            point.new = 2
        with pytest.raises(FrozenInstanceError, match="cannot delete field 'x'"):
            del child.x
        child.new = 2
        assert child.new == 2
        assert point.norm == 1


def test_replace_and_hashes() -> None:
    point = OURS["Point"]
    moved = dataclasses.replace(point(1, 2), y=5)
    assert (moved.x, moved.y) == (1, 5)
    assert hash(point(1, 2)) == hash(STANDARD["Point"](1, 2))
    assert len({point(1, 2), point(1, 2), moved}) == 2


def test_wrong_arguments_are_named_alike() -> None:
    for made in (OURS, STANDARD):
        with pytest.raises(TypeError, match=r"Point.__init__\(\) got an unexpected keyword argument 'w'"):
            made["Point"](1, w=2)


def test_threads_may_use_a_class_first_at_once() -> None:
    for _ in range(50):
        cls = family(deferred_dataclass)["Solid"]
        gate = threading.Barrier(4)
        wrong: list[object] = []

        def use(cls: type[Any] = cls, gate: threading.Barrier = gate, wrong: list[object] = wrong) -> None:
            gate.wait()
            try:
                assert cls(1, 2) == cls(1, 2)
            except BaseException as error:
                wrong.append(error)

        users = [threading.Thread(target=use) for _ in range(4)]
        for user in users:
            user.start()
        for user in users:
            user.join()
        assert wrong == []


def test_what_another_process_pickled_is_complete() -> None:
    program = (
        "import pickle, sys; from ensemble_ctrl.problem.checks.finding import Finding; "
        "sys.stdout.buffer.write(pickle.dumps(Finding(('a',), 'text')))"
    )
    made = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True).stdout
    reader = "import pickle, sys; a = pickle.loads(sys.stdin.buffer.read()); print(repr(a), a == a.__class__('b', ''))"
    done = subprocess.run([sys.executable, "-c", reader], input=made, capture_output=True, check=True).stdout.decode()
    assert done.startswith("Finding(path=('a',), message='text'")
    assert done.endswith("False\n")
    assert pickle.loads(made).message == "text"


def deferred_classes() -> Iterator[type[Any]]:
    """All classes of the package that are completed later."""
    import importlib
    import pkgutil

    import ensemble_ctrl

    for module in pkgutil.walk_packages(ensemble_ctrl.__path__, "ensemble_ctrl."):
        if not module.name.endswith("__main__"):
            loaded = importlib.import_module(module.name)
            for value in vars(loaded).values():
                if isinstance(value, type) and value.__module__ == module.name:
                    yield value


def test_every_class_of_the_package_can_be_completed() -> None:
    waiting = [
        cls for cls in deferred_classes() if any(isinstance(member, _Deferred) for member in list(vars(cls).values()))
    ]
    for cls in waiting:
        assert dataclasses.fields(cls) is not None
        assert not any(isinstance(member, _Deferred) for member in vars(cls).values())
