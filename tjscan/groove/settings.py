"""What a groove looks like, and how it is looked for: templates, settings, budgets of the search.

A template has sides and the corners between them. Sides run from the brace's wall (or the first
plate) to the leg (or the second plate). A turn is positive in a valley and negative on a ridge, as
the sensor sees it. A new groove is a new value.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Annotated, Final

from annotated_types import Ge, Gt, Le

from tjscan.core.units import MM, ChosenByName, SettingsTable

LEAST_SIDES: Final = 3

SECTION_SIDES: Final = 4
"""Sides of a groove with the five points of a section."""


@dataclass(frozen=True, slots=True)
class SideModel:
    """Model of a groove's side: its name, length bounds, and how far it may be from straight.

    Parameters
    ----------
    name : str
        What it is called in messages.
    shortest, longest : float
        Bounds of its length, in metres; the first and the last side may run on.
    bend, twist : float
        How far its cross-section ``c2 s² + c3 s³`` may be from straight: standard deviations of
        c2, in 1/m, and of c3, in 1/m². A pipe of radius R cut across has c2 = 1 / (2 R).
    expected_bend : float, optional
        About which c2 scatters, in 1/m; None if it scatters about zero, and the side may as
        well be straight.
    bead : bool
        Whether it is the face of a weld bead, which may bulge or sag by a good part of its width.
    """

    name: str
    shortest: float
    longest: float = 0.2
    bend: float = 0.0
    twist: float = 0.0
    expected_bend: float | None = None
    bead: bool = False


@dataclass(frozen=True, slots=True)
class TurnBounds:
    """Bounds of the angle by which one side turns to the next, in radians."""

    least: float
    most: float


@dataclass(frozen=True, slots=True)
class GrooveModel:
    """Model of a groove's shape: its sides and the turns between them.

    Parameters
    ----------
    name : str
    sides : tuple of SideModel
        At least three; the first and the last are the long outer ones.
    turns : tuple of TurnBounds
        One fewer: from each side to the next.
    across : TurnBounds
        From the first side to the last.
    alternatives : tuple of GrooveModel
        What such a groove may look like instead; the points decide.
    likely_another : bool
        Whether it likely looks like one of these: then it is compared with all of them, however
        well it fits by itself.
    """

    name: str
    sides: tuple[SideModel, ...]
    turns: tuple[TurnBounds, ...]
    across: TurnBounds
    alternatives: tuple[GrooveModel, ...] = ()
    likely_another: bool = False

    def __post_init__(self) -> None:
        if len(self.sides) < LEAST_SIDES or len(self.turns) != len(self.sides) - 1:
            raise ValueError("a groove has three sides or more, and a turn between each two")

    @property
    def has_section_points(self) -> bool:
        """Whether its corners are the five points of a section, which a scan needs."""
        return len(self.sides) == SECTION_SIDES

    @property
    def has_root_bead(self) -> bool:
        """Whether the last side but one is the face of a root bead."""
        return self.sides[-2].bead


OPENING_LEAST: Final = radians(20)
OPENING_MOST: Final = radians(100)
"""Bounds of the angle between the two faces of any groove, in radians."""

_RIDGE_TURN: Final = TurnBounds(-radians(100), -radians(6))
_HALF_VALLEY_TURN: Final = TurnBounds(radians(8), radians(150))
_VALLEY_TURN: Final = TurnBounds(radians(180) - OPENING_MOST, radians(180) - OPENING_LEAST)
_ROOT_FACE: Final = SideModel("root", 0.8e-3, 14e-3, bend=100.0, twist=8000.0, bead=True)

_KNEE_TURN: Final = TurnBounds(-radians(16), radians(16))
_WALL_SIDE: Final = SideModel("wall", 4e-3, bend=0.7)
_BEVEL_SIDE: Final = SideModel("bevel", 4e-3, 120e-3, bend=0.25)
_LEG_SIDE: Final = SideModel("leg", 4e-3, bend=5.0, twist=10.0)
_TEE_ACROSS: Final = TurnBounds(radians(8), radians(150))

TEE_TWO_FACETS: Final = GrooveModel(
    "tee with two facets",
    (
        _WALL_SIDE,
        SideModel("upper bevel", 3e-3, 80e-3),
        # A shorter one can't be distinguished from a flank that light between the faces pulls in.
        SideModel("lower bevel", 6e-3, 80e-3),
        _ROOT_FACE,
        _LEG_SIDE,
    ),
    (_RIDGE_TURN, _KNEE_TURN, _HALF_VALLEY_TURN, _HALF_VALLEY_TURN),
    _TEE_ACROSS,
)
"""The same with a bevel ground or cut in two facets."""

TEE_NO_ROOT: Final = GrooveModel(
    "tee without a root face",
    (_WALL_SIDE, _BEVEL_SIDE, _LEG_SIDE),
    (_RIDGE_TURN, _VALLEY_TURN),
    _TEE_ACROSS,
)
"""The same if no face closes the root, or none is seen."""

TEE_GROOVE: Final = GrooveModel(
    "tee",
    (_WALL_SIDE, _BEVEL_SIDE, _ROOT_FACE, _LEG_SIDE),
    (_RIDGE_TURN, _HALF_VALLEY_TURN, _HALF_VALLEY_TURN),
    _TEE_ACROSS,
    (TEE_TWO_FACETS, TEE_NO_ROOT),
)
"""Tubular T-joint: wall, bevel, root and leg; five points."""

_PLATES_TURN: Final = TurnBounds(-radians(30), radians(30))
_FIRST_PLATE: Final = SideModel("plate", 4e-3, bend=0.3)
_OTHER_PLATE: Final = SideModel("other plate", 4e-3, bend=0.3)
# Cut or ground by hand, a bevel bows by a tenth of a millimetre in 20 mm.
_BUTT_BEVEL: Final = SideModel("bevel", 3e-3, 80e-3, bend=1.0)
_OTHER_BEVEL: Final = SideModel("other bevel", 3e-3, 80e-3, bend=1.0)
_BUTT_ROOT: Final = SideModel("root", 0.8e-3, 45e-3, bend=100.0, twist=8000.0, bead=True)

BUTT_V_SHARP: Final = GrooveModel(
    "butt-v-sharp",
    (_FIRST_PLATE, _BUTT_BEVEL, _OTHER_BEVEL, _OTHER_PLATE),
    (_RIDGE_TURN, _VALLEY_TURN, _RIDGE_TURN),
    _PLATES_TURN,
)
"""Butt joint whose bevels, drawn on, meet in a sharp valley: three corners."""

BUTT_V: Final = GrooveModel(
    "butt-v",
    (_FIRST_PLATE, _BUTT_BEVEL, _BUTT_ROOT, _OTHER_BEVEL, _OTHER_PLATE),
    (_RIDGE_TURN, _HALF_VALLEY_TURN, _HALF_VALLEY_TURN, _RIDGE_TURN),
    _PLATES_TURN,
    (BUTT_V_SHARP,),
)
"""Butt joint with a root face or with beads up to any height: four corners; three without."""

GROOVE_MODELS: Final = {model.name: model for model in (TEE_GROOVE, BUTT_V, BUTT_V_SHARP)}
"""The templates by name."""


@dataclass(frozen=True, slots=True)
class GrooveSettings(SettingsTable):
    """Settings for reading grooves: the table [groove].

    Parameters
    ----------
    model : GrooveModel
        What it looks like.
    noise : float
        Largest standard deviation of the range that is expected, in metres.
    minimum_points : int
        Fewest points of a profile that are worth a search.
    largest_sigma : float
        Largest standard deviation of a corner that is still an answer, in metres.
    largest_rms : float
        Largest deviation of the points from the fitted sides, in metres (rms).
    inlier_share : float
        Least share of a side's points that must lie on it.
    """

    model: Annotated[GrooveModel, ChosenByName(GROOVE_MODELS)] = TEE_GROOVE
    noise: Annotated[float, Gt(0), Le(5), MM] = 0.05e-3
    minimum_points: Annotated[int, Ge(20), Le(10_000)] = 80
    largest_sigma: Annotated[float, Gt(0), Le(10), MM] = 0.6e-3
    largest_rms: Annotated[float, Gt(0), Le(10), MM] = 0.15e-3
    inlier_share: Annotated[float, Gt(0), Le(1)] = 0.1

    def __post_init__(self) -> None:
        if not (self.noise > 0 and self.largest_sigma > 0 and self.largest_rms > 0):
            raise ValueError("noise, largest_sigma and largest_rms must be positive")

    @property
    def support_tolerance(self) -> float:
        """Distance from a hypothesis within which points support it, in metres."""
        return TOLERANCE_SIGMAS * self.noise


TOLERANCE_SIGMAS: Final = 4.0
"""The tolerance in expected standard deviations."""

DEFAULT_SETTINGS: Final = GrooveSettings()


@dataclass(frozen=True, slots=True)
class SearchBudget:
    """Limits of the search for a groove: numbers of hypotheses, pairs and refits.

    Parameters
    ----------
    windows : tuple of int
        Lengths of the windows that propose long sides, in points, each half the one before.
    gap_cost : float
        What an outlier costs the stretch of a long side, in points; less where reflections
        hide most of it.
    refits : int
        How often long sides are fitted again before they are judged.
    kept : int
        Most segments kept as long sides.
    pairs : int
        Most pairs of outer sides tried.
    proposals : int
        Most pairs of points that propose a line between outer sides.
    pool : int
        Most lines that may be one inner side.
    """

    windows: tuple[int, ...]
    gap_cost: float
    refits: int
    kept: int
    pairs: int
    proposals: int
    pool: int


_COARSE, _FINE = (48, 24), (48, 24, 12, 6)

SEARCH_BUDGETS: Final = (
    SearchBudget(_COARSE, gap_cost=0.35, refits=1, kept=6, pairs=3, proposals=64, pool=8),
    SearchBudget(_FINE, gap_cost=0.35, refits=2, kept=8, pairs=3, proposals=360, pool=16),
    SearchBudget(_FINE, gap_cost=0.12, refits=2, kept=16, pairs=8, proposals=360, pool=16),
)
"""One after the other, until a groove is read."""


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """When the search tries a start, keeps a fit and is convinced by it.

    Parameters
    ----------
    fewest_points_on_side : int
        Fewest points on a side.
    partial_groove_share : float
        A part of a groove that leaves no greater share of the points unexplained is one.
    length_slack : float
        A fitted side may be shorter than the model's shortest, or longer than its longest, by this
        factor.
    same_start_distance : float
        A hypothesis whose corners differ by less, in metres, from those of another one, or of what
        came of it, is not refined again.
    strayed_share : float
        A refined hypothesis that explains fewer points than before, by this share, has strayed.
    side_cost : float
        What a model's every side costs, in outliers: BIC's penalty for a line and its end where
        some ninety points of a profile are independent.
    unexplained_shares : tuple of float
        Share of the points that a fit may leave unexplained for each budget and need no other one.
    refit_gain : float
        More points than this, beyond those that its sides explain as they are, no refit of a fit
        explains.
    near_side_tolerances : float
        Points this near a side, in tolerances, are of its surface or of what sticks to it, as
        scale.
    reflected_share : float
        Share of the points that a fit may leave to reflections if all others are near its sides.
    corner_reach : float
        Points of both sides lie this near a corner that is seen, in metres.
    fewest_at_corner : int
        Points of a side that show its corner.
    detached_cost : float
        What a side whose points end before its corner costs, in outliers: reflections often do.
    seen_share : float
        Share of a side's points that must lie on it if no other form is to be tried.
    straight_undulation : float
        A side that undulates by more, in metres, may be two.
    recoverable_share : float
        Share of the points a hypothesis leaves unexplained that other outer sides may yet explain.
    """

    fewest_points_on_side: int = 4
    partial_groove_share: float = 0.25
    length_slack: float = 0.8
    same_start_distance: float = 0.3e-3
    strayed_share: float = 0.05
    side_cost: float = 5.0
    unexplained_shares: tuple[float, ...] = (0.3, 0.45, 1.0)
    refit_gain: float = 6.0
    near_side_tolerances: float = 3.0
    reflected_share: float = 0.08
    corner_reach: float = 1.5e-3
    fewest_at_corner: int = 2
    detached_cost: float = 2.0
    seen_share: float = 0.25
    straight_undulation: float = 0.08e-3
    recoverable_share: float = 0.5


SEARCH_SETTINGS: Final = SearchSettings()


@dataclass(frozen=True, slots=True)
class ProposalSettings:
    """What proposes sides, and which polylines of them are worth a fit.

    Parameters
    ----------
    thinned_count : int
        About how many points judge a window: noise is correlated over more than what is skipped.
    curvature_spread : float
        Standard deviation of a side's curvature coefficient, 1/m: pipes of a radius of 170 mm.
    least_segment_gain : float
        What a segment has to add to those before it, in points of the thinned row.
    wide_gap : int
        Points without support that may divide a segment into two sides.
    gap_cost : float
        What a point costs the stretch it lies in, in points, unless the line explains it.
    support_gain : float
        Gain from which a line counts as explaining a point.
    outer_margin : int
        Points of the outer sides that may belong to the sides between them.
    fewest_inner_points : int
        Points that must support an inner side.
    least_support_share : float
        Share of an inner side's points that must support it.
    distinct_distance : float
        Chains that differ less than this at every corner are the same one, in metres.
    most_refined : int
        Most hypotheses looked at more closely.
    most_compared : int
        Most hypotheses of which the distinct ones are sought.
    rival_margin : float
        By how many outliers a hypothesis may be dearer than the cheapest and still be looked at.
    nearest_range : float
        Least distance of anything from the sensor, in metres.
    corner_room : float
        How far a corner may lie outside all points, in metres.
    """

    thinned_count: int = 107
    curvature_spread: float = 3.0
    least_segment_gain: float = 1.0
    wide_gap: int = 10
    gap_cost: float = 0.15
    support_gain: float = 0.2
    outer_margin: int = 10
    fewest_inner_points: int = 4
    least_support_share: float = 0.12
    distinct_distance: float = 1e-3
    most_refined: int = 3
    most_compared: int = 150
    rival_margin: float = 12.0
    nearest_range: float = 0.02
    corner_room: float = 30e-3


PROPOSAL_SETTINGS: Final = ProposalSettings()


@dataclass(frozen=True, slots=True)
class FormSettings:
    """What suggests a bead at the root or a knee in the bevel.

    Parameters
    ----------
    fewest_bead_points : int
        Points between the neighbours that are worth a parabola.
    fewest_face_run : int
        Points that show where a face goes which begins at bevel or leg.
    least_bead_gain : float
        By how many points a parabola must explain more than a straight face.
    reach_cost : float
        What each point costs a face that reaches farther, times the logarithm of how much farther.
    knee_reach : float
        Farther from the side a point proposes nothing, in metres.
    fewest_divided_points : int
        Points of a side that is worth dividing.
    """

    fewest_bead_points: int = 6
    fewest_face_run: int = 4
    least_bead_gain: float = 3.0
    reach_cost: float = 0.3
    knee_reach: float = 2.0e-3
    fewest_divided_points: int = 12


FORM_SETTINGS: Final = FormSettings()


@dataclass(frozen=True, slots=True)
class RefinementSettings:
    """Which points a side is fitted to, and when a fit is final.

    Parameters
    ----------
    largest_fit_share : float
        No fit is thought to take out a greater share of the noise.
    fewest_blocks : int
        Blocks that distinguish undulation from noise.
    significant_sigmas : float
        Standard deviations from which a departure or an undulation is none of chance.
    shadow_sigmas : float
        Off the surface by more, in standard deviations, and next to a run of outliers: a ghost.
    shadow_run : int
        Outliers that make a run.
    fewest_side_points : int
        Points that a side can be fitted to.
    pooled_noise_points : int
        A side of few points can't show its own noise: it leans on all by as many points as this.
    face_bluntness : float
        Share of its height by which the face of a bead may lie off a parabola: its points are
        within that of the fit.
    outer_side_reach : float
        Points of a rough or patched outer side lie within so many tolerances of it.
    first_tolerances : tuple of float
        Tolerance of the first rounds: a side known from one end only must find its other end.
    settled_sigmas : float
        Corners that move less from one round to the next are final, in standard deviations.
    same_fit_distance : float
        Fits whose corners differ by less, in metres, become the same.
    undecided_rounds : int
        Rounds in all, and rounds after which sides become straight or curved at the latest.
    rebased_rounds : int
        Rounds after each of which the chords become tangents again; later they lean too little.
    straight_log_odds : float
        Log of the odds from which a side is straight: a factor of 3, for few points show little.
    rim_points, largest_curl, least_curl_sigmas, fewest_curled_rims : float or int
        Points on either side of a hole that may curl; how far they lie off at most, in metres, and
        at least, in standard deviations; and how many rims must be seen to curl.
    """

    largest_fit_share: float = 0.6
    fewest_blocks: int = 3
    significant_sigmas: float = 3.0
    shadow_sigmas: float = 0.7
    shadow_run: int = 3
    fewest_side_points: int = 3
    pooled_noise_points: int = 20
    face_bluntness: float = 0.2
    outer_side_reach: float = 3.0
    first_tolerances: tuple[float, ...] = (4.0, 2.0)
    settled_sigmas: float = 1.0
    same_fit_distance: float = 0.05e-3
    undecided_rounds: int = 3
    rebased_rounds: int = 4
    straight_log_odds: float = 1.1
    rim_points: int = 8
    largest_curl: float = 0.6e-3
    least_curl_sigmas: float = 2.5
    fewest_curled_rims: int = 2


REFINEMENT_SETTINGS: Final = RefinementSettings()


@dataclass(frozen=True, slots=True)
class ReflectionSettings:
    """What runs of reflections cost, and what other readings count for.

    Parameters
    ----------
    jump_distance, jump_steepness : float
        Neighbouring points of one surface lie no farther apart than this, in metres, with this many
        times the distance of their neighbours.
    hole_columns : int
        Columns without points after which nothing shows whether a surface goes on.
    run_cost, point_cost : float
        What a run of reflections costs, in outliers, and each of its points.
    point_log_odds : float
        Logarithm of the odds that one point explained more is worth: points of a reflection come in
        runs, and noise is correlated, so that a point counts for a part of an independent one.
    least_odds : float
        Readings less likely than this, over the likeliest, are left out.
    reflection_distance : float
        How far reflections lie off the surface, in metres.
    far_distance : float
        Farther from its side, in metres, a point is a reflection.
    most_reflected : float
        Greatest probability that a side which hangs together with no other is a reflection.
    meeting_reach, fewest_meeting, fewest_hiding : float or int
        Points of a side, so near a corner in metres, that show it there; and points between two
        sides that hide how one goes over into the other.
    same_reading_distance : float
        Readings whose corners differ by less, in metres, are one.
    """

    jump_distance: float = 0.5e-3
    jump_steepness: float = 1.5
    hole_columns: int = 6
    run_cost: float = 3.0
    point_cost: float = 0.35
    point_log_odds: float = 0.25
    least_odds: float = 0.01
    reflection_distance: float = 3e-3
    far_distance: float = 0.6e-3
    most_reflected: float = 0.25
    meeting_reach: float = 1.5e-3
    fewest_meeting: int = 2
    fewest_hiding: int = 3
    same_reading_distance: float = 0.05e-3


REFLECTION_SETTINGS: Final = ReflectionSettings()


@dataclass(frozen=True, slots=True)
class ShapeSettings:
    """What a surface may do that no line, arc or cubic does.

    Parameters
    ----------
    corner_neighbourhood : float
        Points this near a corner, in metres along their side, belong to its neighbourhood.
    reflection_offset : float
        Farther from its side a point is a reflection, in metres.
    fewest_beside_corner : int
        Points that show a departure.
    patch_reach : float
        Points this near a side, in metres, are of its surface or of what sticks to it.
    fewest_patch_points, corner_points : int
        Points that show patches, and points next to each corner that do not.
    rough_factor : float
        Factor over the usual from which a side is rough or patched.
    patch_sigmas, patched_share : float
        Standard deviations off its side where a point is on a patch, and the share of such points
        that makes a side patched: single spatter does not.
    unseen_slope : float
        Slope by which a side may turn where it is not seen: half the angle between two facets that
        a bevel may have, and as often it does not.
    pull_probability : float
        Probability that a notch which looks pulled in by light is, and no fillet.
    unseen_face_slope : float
        Slope by which the face of a bead may turn where it is not seen: it has no plan.
    leaving_points, leaving_step : float or int
        Points in a row that leave a side, and the most by which one lies farther off than the last,
        in metres.
    residual_jump : float
        Neighbouring points of one surface lie no farther apart, square to it, in metres.
    face_end_share : float
        A bead's face is no parabola: its ends may lie off one by this share of its height. One that
        rises twice as steeply from its toes as a parabola does is off by a seventh.
    """

    corner_neighbourhood: float = 1.5e-3
    reflection_offset: float = 2.0e-3
    fewest_beside_corner: int = 4
    patch_reach: float = 0.6e-3
    fewest_patch_points: int = 12
    corner_points: int = 3
    rough_factor: float = 1.6
    patch_sigmas: float = 3.5
    patched_share: float = 0.15
    unseen_slope: float = 0.04
    pull_probability: float = 0.5
    unseen_face_slope: float = 0.15
    leaving_points: int = 6
    leaving_step: float = 0.25e-3
    residual_jump: float = 0.7e-3
    face_end_share: float = 0.1


SHAPE_SETTINGS: Final = ShapeSettings()


@dataclass(frozen=True, slots=True)
class NotchSettings:
    """How light between the faces may pull a notch in.

    Parameters
    ----------
    steepest_pull : float
        A pull is smooth: it is no greater than this share of its reach.
    pull_prior_odds : float
        Odds that a notch is pulled in, before its points are looked at.
    pull_shape_spread : float
        A pull may differ from a raised cosine by this share, one standard deviation.
    notch_region : float
        Points this near a corner are looked at, in metres along its flank.
    fewest_face_points : int
        Where, as shares of its points, those lie that propose flatter faces; fewest points for
        that.
    least_turn_sine : float
        Least sine of the turn between a flank and a face that have a corner.
    pull_reach : float
        Distance from a notch in metres within which points are pulled in: real profiles show 3 to 5
        mm.
    pull_doubt : float
        Share of itself by which a pull is uncertain, for its reach is.
    fewest_pulled_points : int
        Points about a notch that show a pull.
    """

    steepest_pull: float = 0.5
    pull_prior_odds: float = 0.1
    pull_shape_spread: float = 0.05
    notch_region: float = 8e-3
    fewest_face_points: int = 8
    least_turn_sine: float = 0.15
    pull_reach: float = 4e-3
    pull_doubt: float = 0.15
    fewest_pulled_points: int = 4


NOTCH_SETTINGS: Final = NotchSettings()


@dataclass(frozen=True, slots=True)
class ScaleSettings:
    """How mill scale covers a side, and what shows it.

    Parameters
    ----------
    misled_share : float
        Share of the profiles whose flanks the model of a pull does not describe: they show nothing.
    scale_block : int
        Points that are averaged.
    fewest_blocks_of_side : int
        Blocks of a side that show something.
    surface_reach : float
        Points this near a side, in metres, are of its surface or of what lies on it.
    block_undulation : float
        Standard deviation, in metres, of a block of points beyond noise: no surface is a parabola.
    steepest_steel : float
        Slope against the fitted side that the steel under scale may have.
    widest_bend : float
        Bends that are tried, in standard deviations about the expected one; and the largest one of
        these, in 1/m, with which a side is looked at.
    most_tried_lines : int
        Lines that are tried.
    stray_cost : float
        What a block costs that lies on neither level, in squared standard deviations.
    covered_share, patch_width : float
        Share of a surface that scale covers, and about how wide its patches are, in metres:
        assumptions, after what tubes show that have lain in a yard.
    block_weight : float
        Weight of a block's evidence: neighbours undulate together.
    """

    misled_share: float = 0.02
    scale_block: int = 6
    fewest_blocks_of_side: int = 5
    surface_reach: float = 1.0e-3
    block_undulation: float = 0.02e-3
    steepest_steel: float = 0.06
    widest_bend: float = 1.0
    most_tried_lines: int = 80
    stray_cost: float = 9.0
    covered_share: float = 0.35
    patch_width: float = 12e-3
    block_weight: float = 0.5


SCALE_SETTINGS: Final = ScaleSettings()


@dataclass(frozen=True, slots=True)
class PriorSettings:
    """How what persists along a groove carries over to the next section.

    Parameters
    ----------
    absence_probability : float
        Probability that there is no scale, or no pull: as likely as not.
    usual_pull : float
        About how far a notch is pulled in, in metres, if it is.
    alike_length : float
        Length of groove over which scale and the faces' gloss stay alike, in metres.
    patch_length : float
        Sections nearer to each other, in metres, show the same patches of scale.
    bend_change : float
        By how much a side's bend changes along the groove, in 1/m per metre: that of a leg of 600
        mm from none at the crown to all of it at the saddle. Across the groove it changes no
        faster.
    bend_sigma : float
        Least standard deviation of a bend in 1/m: of 0.02 mm in 12 mm, which undulation makes too.
    sections_with_forms : int
        Of so many sections before, one with another form is reason enough to look for it again.
    straight_bend : float
        A side that bends by less, in 1/m, is most likely straight: how far others seemed to bend
        shows less of it than that.
    change_probability : float
        Probability that scale or pull are no more as they were: then nothing is known of them.
    """

    absence_probability: float = 0.5
    usual_pull: float = 0.5e-3
    alike_length: float = 0.5
    patch_length: float = 20e-3
    bend_change: float = 5.0
    bend_sigma: float = 0.15
    sections_with_forms: int = 3
    straight_bend: float = 1.0
    change_probability: float = 0.1


PRIOR_SETTINGS: Final = PriorSettings()


@dataclass(frozen=True, slots=True)
class RootSettings:
    """What distinguishes a tack, an opening, a bead and a seam weld at the root.

    Parameters
    ----------
    tack_ratio, tack_height : float
        Height of a tack over its chord: a share of it, and metres. A pass that lies in a groove
        wets both faces and is lower; a root bead that bulges is smaller.
    weld_ratio : float
        Height over its chord, as a share of it, from which a face is that of convex weld metal.
    least_opening : float
        Distance between the end of a bevel and the leg that makes an open root, in metres.
    points_under, fewest_under : int
        Of so many points after the end of a bevel, so many must lie on the leg under it where a
        root is open.
    least_cap, most_cap, cap_height : float
        Width and least height of a seam weld's cap, in metres.
    cap_foot : float
        An end of a cap lies lower than this share of its height: it grows out of the surface.
    cap_step : float
        Neighbouring points of a cap differ in height by less than this share of it.
    buried_chords : float
        Distance along bevel or leg from a tack's toe to the corner under it, in chords of the tack.
    least_unseen : float
        Least standard deviation, in metres along its side, of a corner that is not seen.
    any_form_probability : float
        Probability that a root which is not seen has no face: as likely as not.
    notch_reflections : float
        By how much reflections are denser about a notch, where light finds many ways.
    farthest_root : float
        Metres along bevel or leg in which the root lies.
    """

    tack_ratio: float = 0.165
    tack_height: float = 1.45e-3
    weld_ratio: float = 0.06
    least_opening: float = 0.8e-3
    points_under: int = 40
    fewest_under: int = 2
    least_cap: float = 5e-3
    most_cap: float = 30e-3
    cap_height: float = 0.5e-3
    cap_foot: float = 0.5
    cap_step: float = 0.4
    buried_chords: float = 0.5
    least_unseen: float = 0.5e-3
    any_form_probability: float = 0.5
    notch_reflections: float = 2.0
    farthest_root: float = 20e-3


ROOT_SETTINGS: Final = RootSettings()
