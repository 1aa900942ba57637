"""Thresholds of vision, each with its unit and the reason for its value.

A scenario sets them with `localizer.thresholds`. What other values change is measured
by `drake-srg experiment localizer_thresholds`.
"""

import dataclasses as dc
import math

from drake_srg.types import positive

_SHARE = {"ge": 0.0, "le": 1.0}
_SOFTNESS = positive(nonempty=True)


@dc.dataclass(kw_only=True)
class DepthNoiseConfig:
    """Thresholds for measuring and reducing the noise of a depth image."""

    # An image with less noise stays as it is [1/m]: 0.05 mm at 1.5 m is a twentieth of
    # what matters, and cleaning rounds corners.
    noiseless: float = dc.field(default=2e-5, metadata={"ge": 0.0})
    # A hole is filled if at least this many of its eight neighbours are known.
    known_neighbours: int = dc.field(default=3, metadata={"ge": 1, "le": 8})
    # Distance between the pixels that are compared [pixels]. The noise of nearer ones
    # is correlated.
    lag: int = dc.field(default=4, metadata={"ge": 1})


@dc.dataclass(kw_only=True)
class AnyLightConfig:
    """Thresholds for recognising a colour under an unknown light."""

    # How far a light may change red over green and blue over green [natural logarithm].
    # Lamps of 3000 to 8000 K differ from daylight by factors of up to 1.3 and 1.5
    # (black bodies in sRGB's primaries).
    light_change: list[float] = dc.field(
        default_factory=lambda: [0.26, 0.41], metadata={"length": 2, "ge": 0.0}
    )
    # Quantile of the image's values that shows how bright the light is. Brighter pixels
    # may be lamps and reflections.
    bright_quantile: float = dc.field(default=0.9, metadata=_SHARE)
    # Least brightness of a shaded object, as a share of its brightness in full light.
    shaded: float = dc.field(default=0.4, metadata=_SHARE)
    # What a camera reads of black [counts of 255].
    dark: float = dc.field(default=8.0, metadata=positive(le=255.0))
    # Samples of a colour range along each channel.
    samples: int = dc.field(default=9, metadata={"ge": 2})


@dc.dataclass(kw_only=True)
class CandidatesConfig:
    """Thresholds for grouping pixels that may show a target."""

    # Least step in depth at an object's edge, as a share of its least extent. A surface
    # that continues behind the object is farther off.
    step: float = dc.field(default=0.25, metadata=positive())
    # A step also exceeds this many standard deviations of noise.
    deviations: float = dc.field(default=6.0, metadata={"ge": 0.0})
    # Least area of a region, as a share of the object's smallest face. A smaller region
    # does not show what it is.
    least_area: float = dc.field(default=0.08, metadata={"ge": 0.0})
    # Likewise, of a thing that is seen whole. From any side, a box, cylinder or ball
    # covers at least 0.79 of the smallest face of the box around it.
    least_whole_area: float = dc.field(default=0.5, metadata={"ge": 0.0})
    # A thing is seen whole if at most this share of the pixels beside it is neither the
    # ground nor far behind it.
    most_else_beside: float = dc.field(default=0.05, metadata=_SHARE)
    # Share of a region's surroundings that must lie behind it, at least, and share that
    # may lie level with it, at most. The rest may hide it or touch it.
    least_behind: float = dc.field(default=0.3, metadata=_SHARE)
    most_level: float = dc.field(default=0.25, metadata=_SHARE)
    # Width of the rim around a region [pixels]. The pixels of a step itself are neither
    # before nor behind it.
    rim: int = dc.field(default=2, metadata={"ge": 0})
    # Width of the band beyond the rim that shows the surroundings [pixels].
    beside: int = dc.field(default=5, metadata={"ge": 1})


@dc.dataclass(kw_only=True)
class GuessesConfig:
    """Thresholds for first guesses of a pose."""

    # Least thickness of a plane [m]: a renderer's depth has no noise.
    plane_thickness: float = dc.field(default=5e-5, metadata=positive())
    # A top that leans more than this is not understood and counts as level [rad].
    most_lean: float = dc.field(
        default=math.radians(15.0), metadata={"ge": 0.0, "le": 1.5}
    )


@dc.dataclass(kw_only=True)
class SightConfig:
    """Thresholds for telling a solid's surface from everything else."""

    # Distance that a visible point of the solid may always be off its surface [m], and
    # the same as a share of its radius. A renderer's depth has no noise, but Drake
    # draws circles with 50 sides, up to 0.2 % inside the radius.
    finest: float = dc.field(default=1e-4, metadata=positive())
    finest_share: float = dc.field(default=3e-3, metadata={"ge": 0.0})
    # Distance that it may be off if the points scatter or the pose is in doubt [m].
    coarsest: float = dc.field(default=3e-3, metadata=positive())
    # Both are at least this many standard deviations of noise.
    deviations: float = dc.field(default=4.0, metadata={"ge": 0.0})
    # A surface is visible where ray times outward normal is less than this. It is not 0
    # because depth is too coarse where a surface is seen edge-on.
    edge_on: float = dc.field(default=0.3, metadata=_SHARE)


@dc.dataclass(kw_only=True)
class AlignmentConfig:
    """Settings of the optimisation that aligns a pose with an image."""

    # Least standard deviation of depth [m]; see `SightConfig.finest`.
    depth_deviation: float = dc.field(default=1e-4, metadata=positive())
    # Where Huber's cost turns linear [standard deviations]; 95 % efficient for normally
    # distributed noise.
    huber: float = dc.field(default=1.345, metadata=positive())
    # Greatest number of points, and of pixels, that take part. More add little.
    samples: int = dc.field(default=400, metadata={"ge": 10})
    # Steps of Newton's method at one softness, at most.
    steps: int = dc.field(default=12, metadata={"ge": 1})
    # Added to the Hessian's diagonal, as a share of its trace.
    ridge: float = dc.field(default=1e-9, metadata=positive())


@dc.dataclass(kw_only=True)
class FitConfig:
    """Thresholds for fitting a solid to a blob and for judging the fit."""

    # Softness of the outline in the stages of a fit [pixels]: a guess is a few pixels
    # off. One label shows where an edge is with a standard deviation of 0.29 pixels,
    # all labels together show more.
    coarse_softness: list[float] = dc.field(
        default_factory=lambda: [3.0, 1.0], metadata=_SOFTNESS
    )
    middle_softness: list[float] = dc.field(
        default_factory=lambda: [0.3], metadata=_SOFTNESS
    )
    fine_softness: list[float] = dc.field(
        default_factory=lambda: [0.1, 0.03], metadata=_SOFTNESS
    )
    # A guess that leaves this share of the blob's pixels unexplained is good enough:
    # another one will hardly leave fewer.
    explained: float = dc.field(default=0.03, metadata=_SHARE)
    # A leaning pose replaces a standing one if it explains this share of the blob's
    # pixels more. Nothing stands that leans a little, but a size that is 1 % off, and
    # blur, look like a lean of 3 degrees.
    upright_margin: float = dc.field(default=0.1, metadata=_SHARE)
    # With a greater unexplained share, the fit is uncertain: it may be another solid.
    most_unexplained: float = dc.field(default=0.1, metadata=_SHARE)
    # With a greater one, the blob belongs to another thing.
    another_object: float = dc.field(default=0.35, metadata=_SHARE)
    # Standard deviations of noise: one of 16,000 normally distributed values is beyond.
    deviations: float = dc.field(default=4.0, metadata={"ge": 0.0})
    # A solid this far below its surroundings is not in a recess, and this far above
    # them it stands on nothing [m].
    apart: float = dc.field(default=0.01, metadata=positive())
    # Pixels of a solid's top, and of its surroundings, that are needed to judge its
    # height.
    least_pixels: int = dc.field(default=8, metadata={"ge": 1})
    # Guesses that are aligned in noisy images, the nearest ones. Each takes time.
    noisy_guesses: int = dc.field(default=3, metadata={"ge": 1})
    # A solid that leans more than this does not stand [rad].
    most_standing_lean: float = dc.field(
        default=math.radians(15.0), metadata={"ge": 0.0, "le": 1.5}
    )
    # Width of the band around a solid that shows where it stands [pixels].
    beside: int = dc.field(default=5, metadata={"ge": 1})
    # A point that is farther off the surface is not explained [m]. It is the error of
    # position that `Fit` calls uncertain.
    off_surface: float = dc.field(default=1e-3, metadata=positive())
    # Samples of the outline for its quality: every 5 degrees of a circle.
    ring: int = dc.field(default=72, metadata={"ge": 8})
    # Greatest standard deviations of a certain fit: position [m] and axis [rad].
    position_deviation: float = dc.field(default=1e-3, metadata=positive())
    axis_deviation: float = dc.field(default=math.radians(1.0), metadata=positive())
    # A certain fit gets worse when the solid slides this far along its axis [pixels].
    slides: list[float] = dc.field(
        default_factory=lambda: [1.75, 2.5], metadata=positive()
    )
    # Most pixels inside the outline that look past the solid, as a share of the blob's.
    # Noise makes some at the rim.
    most_through: float = dc.field(default=0.05, metadata=_SHARE)
    # Nearer to the outline than this, depth may be that of either side [pixels].
    frayed: float = dc.field(default=1.5, metadata={"ge": 0.0})
    # Farther off the outline than this, no part of a pixel is on it [pixels].
    on_outline: float = dc.field(default=math.sqrt(0.5), metadata={"ge": 0.0})
    # Least share of the visible surface that has the target's colour. With less, the
    # surface may be another thing's.
    least_colored: float = dc.field(default=0.1, metadata=_SHARE)


@dc.dataclass(kw_only=True)
class BlobLocalizerConfig:
    """Thresholds of `BlobLocalizer`, step by step."""

    depth_noise: DepthNoiseConfig = dc.field(default_factory=DepthNoiseConfig)
    any_light: AnyLightConfig = dc.field(default_factory=AnyLightConfig)
    candidates: CandidatesConfig = dc.field(default_factory=CandidatesConfig)
    guesses: GuessesConfig = dc.field(default_factory=GuessesConfig)
    sight: SightConfig = dc.field(default_factory=SightConfig)
    alignment: AlignmentConfig = dc.field(default_factory=AlignmentConfig)
    fit: FitConfig = dc.field(default_factory=FitConfig)
    # A blob is uncertain if its misfit exceeds that of the best one by more than this.
    # A target's own noise and edges hardly make as much.
    misfit_margin: float = dc.field(default=0.05, metadata={"ge": 0.0})


@dc.dataclass(kw_only=True)
class ObstacleFinderConfig:
    """Thresholds of `ObstacleFinder`."""

    # A point stands on a surface if it is higher by this many standard deviations of
    # noise: one of three million normally distributed values is beyond.
    deviations: float = dc.field(default=5.0, metadata={"ge": 0.0})
    # Points of an obstacle, at least. Noise makes groups of a few.
    least_pixels: int = dc.field(default=8, metadata={"ge": 1})
    # Points this near to a surface are mostly its own and show how well its height is
    # measured [m].
    near: float = dc.field(default=0.03, metadata=positive())
    # Quantile of an obstacle's heights that counts as its top. The highest of many
    # noisy points is a millimetre higher still.
    top: float = dc.field(default=0.98, metadata=_SHARE)
    # A point this near to a known object belongs to it [m]. The object may be 3 mm off
    # where it is seen, and so may its rim.
    known: float = dc.field(default=0.006, metadata={"ge": 0.0})


@dc.dataclass(kw_only=True)
class CameraLevelingConfig:
    """Thresholds of `CameraLeveling`."""

    # A calibration is not more wrong than this in height [m] and tilt [rad]. What
    # differs more is not the surface.
    most_offset: float = dc.field(default=0.02, metadata=positive())
    most_tilt: float = dc.field(default=math.radians(2.0), metadata=positive(le=0.5))
    # Least and greatest number of points that take part. Fewer say too little about a
    # tilt, more add little.
    least_points: int = dc.field(default=200, metadata={"ge": 3})
    most_points: int = dc.field(default=80_000, metadata={"ge": 3})
    # Points within this many standard deviations of the plane fit it.
    inliers: float = dc.field(default=2.5, metadata=positive())
    # Rounds of fitting the plane and dropping points that do not fit.
    rounds: int = dc.field(default=6, metadata={"ge": 1})


@dc.dataclass(kw_only=True)
class HeightMapConfig:
    """Thresholds of `height_map`."""

    # Points per side of a pixel. At 1.5 m a pixel of a 640x480 image is 2.6 mm wide,
    # wider than a cell.
    subpixels: int = dc.field(default=2, metadata={"ge": 1, "le": 8})
    # Width of holes that are filled [cells].
    hole: int = dc.field(default=2, metadata={"ge": 0})
    # Cells higher above the surface than this form the regions that are checked for
    # reaching too high or over the edge [m].
    thing: float = dc.field(default=0.008, metadata=positive())
    # Whether the map keeps things that reach over its edge. Set it only where the robot
    # is out of view, because the robot reaches over the edge, too.
    over_edge: bool = False
    # The map is unknown this far around a region that is left out, too [cells].
    fringe: int = dc.field(default=4, metadata={"ge": 0})
    # Cells this near to the surface are mostly its own, and their median corrects the
    # heights [m]. With fewer than `least_flat` of them, nothing is corrected.
    near: float = dc.field(default=0.01, metadata=positive())
    least_flat: int = dc.field(default=200, metadata={"ge": 1})


@dc.dataclass(kw_only=True)
class LocalizerThresholds(BlobLocalizerConfig):
    """Thresholds of everything that a scenario's `localizer` configures."""

    obstacles: ObstacleFinderConfig = dc.field(default_factory=ObstacleFinderConfig)
    leveling: CameraLevelingConfig = dc.field(default_factory=CameraLevelingConfig)
