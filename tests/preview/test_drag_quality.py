"""Frames get coarser while they are too slow to follow the mouse, and finer again when they are easy."""

from skinbake.preview.drag_quality import COARSEST, EASY_S, FOLLOWING_S, DragQuality


def test_the_scale_follows_the_time_a_frame_takes():
    """A frame that takes 0.4 s at full size, and time in proportion to its points: 14 frames a second and more."""
    quality, seconds = DragQuality(), []
    for _ in range(6):
        seconds.append(0.4 / quality.scale**2)
        quality = quality.after(seconds[-1])
    assert quality.scale == 3
    assert seconds[-1] < FOLLOWING_S


def test_neither_end_is_passed():
    """As coarse as it gets, and not finer than the screen."""
    assert DragQuality(COARSEST).after(9.0).scale == COARSEST
    assert DragQuality(1).after(EASY_S / 9).scale == 1
    assert DragQuality(3).after(EASY_S / 9).scale == 2
