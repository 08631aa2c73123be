"""Who is wrong among sensors that were compared two by two."""

from __future__ import annotations

from gtsam_nav.audit.blame import suspects


def test_who_contradicts_all_others_is_suspected() -> None:
    assert suspects([("imu", "heading"), ("imu", "dvl")], [("heading", "dvl")]) == ("imu",)


def test_one_who_agrees_with_somebody_is_not() -> None:
    assert suspects([("gnss", "heading")], [("heading", "imu")]) == ("gnss",)


def test_two_alone_are_both_suspected() -> None:
    assert suspects([("imu", "heading")], []) == ("heading", "imu")


def test_two_faults_at_once_are_those_whom_nobody_supports() -> None:
    discordant = [("a", "c"), ("b", "d"), ("a", "b")]
    assert suspects(discordant, [("c", "d")]) == ("a", "b")


def test_without_a_disagreement_nobody_is() -> None:
    assert suspects([], [("imu", "heading")]) == ()
