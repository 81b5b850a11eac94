"""The settings of maps with their limits, and the plan of a frame that is made from them."""

from typing import Any

import pytest

from cadtof_cli.capture.metadata import CaptureMetadata, Modulation, Optics
from cadtof_cli.errors import SettingsError
from cadtof_cli.pipeline.plan import FramePlan, MapSettings
from cadtof_cli.resolver.settings import ResolverSettings


def test_by_default_depth_is_a_range_without_pooling_or_averaging() -> None:
    chosen = MapSettings()
    assert (chosen.depth, chosen.pool, chosen.average, chosen.min_confidence_v) == ("range", 1, 1, None)


@pytest.mark.parametrize("options", [{"min_confidence_v": 0.0}, {"pool": 255}, {"average": 1}, {"depth": "z"}])
def test_values_at_a_limit_reach_the_plan(options: dict[str, Any]) -> None:
    optics = Optics(focal_length_px=28.0)
    plan = FramePlan(metadata=CaptureMetadata(optics=optics), settings=MapSettings(**options))
    assert {name: getattr(plan.settings, name) for name in options} == options
    assert plan.resolver.min_confidence == options.get("min_confidence_v")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"min_confidence_v": -1e-9}, "--min-confidence: found -1e-09, expected a voltage"),
        ({"min_confidence_v": float("inf")}, "--min-confidence: found inf"),
        ({"min_confidence_v": float("nan")}, "--min-confidence: found nan"),
        ({"pool": 2}, "--pool: found 2, expected an odd number of pixels"),
        ({"pool": -1}, "--pool: found -1"),
        ({"pool": 257}, "--pool: found 257, expected an odd number of pixels such as 3 or 5, at most 255"),
        ({"average": 0}, "--average: found 0, expected 1 to 1000000 frames"),
        ({"depth": "y"}, "--depth: found 'y', expected one of range, z"),
    ],
)
def test_values_beyond_a_limit_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        MapSettings(**options)


def test_a_plan_refuses_settings_that_need_more_than_its_capture_has() -> None:
    with pytest.raises(SettingsError, match="optics are unknown"):
        FramePlan(metadata=CaptureMetadata(), settings=MapSettings(depth="z"))
    with pytest.raises(SettingsError, match="optics are unknown"):
        FramePlan(metadata=CaptureMetadata(optics=Optics(lamp_offset_m=(0.03, 0.0, 0.0))))
    with pytest.raises(SettingsError, match="3 paths need at least 3 periods"):
        FramePlan(metadata=CaptureMetadata(), settings=MapSettings(resolver=ResolverSettings(paths=3)))


def test_min_confidence_becomes_a_share_of_the_modulation_amplitude() -> None:
    metadata = CaptureMetadata(modulation=Modulation(amplitude_v=0.25))
    assert FramePlan(metadata=metadata, settings=MapSettings(min_confidence_v=0.05)).resolver.min_confidence == 0.2
    assert FramePlan(metadata=metadata).resolver.min_confidence is None


def test_plans_with_equal_values_are_equal_keys_of_a_cache() -> None:
    def plan(focal_px: float) -> FramePlan:
        return FramePlan(
            metadata=CaptureMetadata(optics=Optics(focal_length_px=focal_px)), settings=MapSettings(pool=3)
        )

    one, same, other = plan(28.0), plan(28.0), plan(29.0)
    assert len({one, same, other}) == len({one.metadata, same.metadata, other.metadata}) == 2
