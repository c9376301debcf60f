"""The tables of arm and laser, of how they err, and of the pose of the laser on the arm.

Every default of an uncertainty is an assumption. It holds for what the tables' documentation
names, and a result calls it assumed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field, replace
from math import radians
from time import monotonic
from typing import Annotated, Any, ClassVar, Final, Literal, Self

import numpy as np
from annotated_types import Ge, Le, MaxLen, MinLen, MultipleOf
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, TypeAdapter
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import core_schema

from tjscan.carrier.drivers import CARRIER_DRIVERS
from tjscan.carrier.kinematics import AxisSettings, CarrierKinematics
from tjscan.core import units
from tjscan.core.config import table_to_dict, validate_table
from tjscan.core.devices import DriverKind, DriverRegistry, is_loopback_host
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, pose_from_euler_zyx
from tjscan.joint.tubes.fit import ArmRepeatability
from tjscan.laser.drivers import LASER_DRIVERS, LaserDriverInputs, LaserFlange
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.model import LaserModel
from tjscan.power.drivers import POWER_DRIVERS
from tjscan.robot.drivers import ARM_DRIVERS
from tjscan.robot.settings import InputShaper, JointAngles

ASSUMED_LASER_LINEARITY: Final = 0.1e-3
"""Metres: assumption, 0.1 % of a 100 mm range; data sheets of the class state 0.1 to 0.2 %."""

ASSUMED_LASER_RANGE_BIAS: Final = 0.02e-3
"""Metres: assumption, what the simulated laser has by default (`tjscan.laser.model`)."""

EVIDENCE_STATED: Final = "stated"
EVIDENCE_ASSUMED: Final = "assumed"


class DeviceGroup:
    """Base of the devices of a job: a context manager that connects and disconnects them all."""

    __slots__ = ()

    @property
    def devices(self) -> tuple[AbstractContextManager[object], ...]:
        """The devices in the order in which they are connected."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            for device in self.devices:
                stack.enter_context(device)
            stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        stack = ExitStack()
        for device in self.devices:
            stack.push(device)
        stack.__exit__(*error)


@dataclass(frozen=True, kw_only=True)
class DeviceSettings(units.SettingsTable):
    """Base of the tables [arm] and [laser]: the driver, and the settings of drivers.

    Each driver has a table of its own below, such as [arm.ur]. It is checked against what the
    driver registers, whether the job uses that driver or not.

    Parameters
    ----------
    driver : str
        Name of the driver.
    id : str, optional
        Name of the device in calibrations and reports.
    drivers : mapping
        The settings of each driver that has a table.
    """

    registry: ClassVar[DriverRegistry[Any]]

    driver: str = "simulated"
    id: Annotated[str | None, MinLen(1)] = None
    drivers: Annotated[Mapping[str, Any], units.NOT_IN_FILE] = field(default_factory=dict)

    @property
    def driver_kind(self) -> DriverKind:
        """Whether the device is real, simulated or replayed from a recording."""
        return DriverKind(self.registry.load(self.driver).kind)

    @property
    def driver_settings(self) -> Any:
        """Settings of the driver that the job names.

        Raises
        ------
        ConfigurationError
            If they have no table, and need one.
        """
        if self.driver in self.drivers:
            return self.drivers[self.driver]
        table = self.registry.load(self.driver).table
        try:
            return validate_table(table, {})
        except ConfigurationError as error:
            name = f"{self.registry.table_key}.{self.driver}"
            lacks = f": {error.message}" if error.key is None else f" with {error.key}"
            raise ConfigurationError(
                f"driver {self.driver!r} needs a table [{name}]{lacks}", key=self.registry.key
            ) from None

    def make_device(self, inputs: Any) -> Any:
        """Make the device that the job names, not yet connected; see `DriverRegistry.make`."""
        return self.registry.make(self.driver, inputs, self.driver_settings)

    @classmethod
    def file_key_types(cls) -> dict[str, Any]:
        """Type of each key that the table has in a file, the drivers' tables included."""
        return super().file_key_types() | dict.fromkeys(cls.registry.names)

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """The schema of a table with the drivers' tables in it."""
        return core_schema.no_info_wrap_validator_function(
            cls._read_device_table,
            super().__get_pydantic_core_schema__(source, handler),
            serialization=core_schema.wrap_serializer_function_ser_schema(_dump_with_drivers),
        )

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """The table's JSON schema, with the drivers' names and tables in it."""
        schema = super().__get_pydantic_json_schema__(core_schema, handler)
        keys = handler.resolve_ref_schema(schema)["properties"]
        keys["driver"]["enum"] = list(cls.registry.names)
        for name in [name for name in cls.registry.names if name not in keys]:
            try:
                table = cls.registry.load(name).table
            except ConfigurationError:  # its extra is not installed
                keys[name] = {"type": "object"}
            else:
                inner = TypeAdapter(table).core_schema
                keys[name] = table.__get_pydantic_json_schema__(inner, handler)
        return schema

    @classmethod
    def _read_device_table(cls, data: Any, read: Callable[[Any], Self]) -> Self:
        if not isinstance(data, dict):
            return read(data)
        driver, keys = data.get("driver"), super().file_key_types()
        for name in cls.registry.names:
            if name in keys and (driver == name or isinstance(data.get(name), dict)):
                raise ConfigurationError(
                    f"a package registers the driver {name!r}, and that is a key of the table "
                    f"[{cls.registry.table_key}]: it has to register it by another name",
                    key=cls.registry.key,
                )
        if isinstance(driver, str):
            cls.registry.load(driver)  # before its table is taken for an unknown key
        names = [name for name in cls.registry.names if name in data and name not in keys]
        own = {name: cls._validate_driver_table(name, data[name]) for name in names}
        table = read({key: value for key, value in data.items() if key not in own})
        table = replace(table, drivers=own)
        table.driver_settings  # noqa: B018 - refuses a driver that needs a table and has none
        return table

    @classmethod
    def _validate_driver_table(cls, name: str, data: Any) -> Any:
        key = f"{cls.registry.table_key}.{name}"
        if not isinstance(data, dict):
            raise ConfigurationError(f"must be a table (found {data!r})", key=key)
        try:
            return validate_table(cls.registry.load(name).table, data)
        except ConfigurationError as error:
            inner = key if error.key is None else f"{key}.{error.key}"
            raise ConfigurationError(error.message, key=inner) from None


def _dump_with_drivers(table: DeviceSettings, write: Callable[[DeviceSettings], Any]) -> Any:
    return write(table) | {name: table_to_dict(own) for name, own in table.drivers.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmUncertaintySettings(units.SettingsTable):
    """The table [arm.uncertainty]: how far the arm may be from where it reports.

    Parameters
    ----------
    absolute : float, optional
        Root mean square distance of the flange from its reported position, because the links
        deviate from the model; metres. If left out, joints deviate as
        `tjscan.robot.settings.PlacementTolerance` assumes, some 0.4 mm at the flange of an arm
        of a metre and more. An arm that was calibrated with its sensor has what its calibration
        found instead.
    repeatability, angular_repeatability : float, optional
        Root mean square of the distance (metres) and the angle (radians) by which the arm does
        not repeat; as in `tjscan.joint.tubes.fit.ArmRepeatability` if left out.
    """

    absolute: Annotated[float | None, Ge(0), Le(20), units.MM] = None
    repeatability: Annotated[float | None, Ge(0), Le(5), units.MM] = None
    angular_repeatability: Annotated[
        float | None, Ge(0), Le(5), units.DEG.with_key("repeatability_deg")
    ] = None

    @property
    def stated_repeatability(self) -> tuple[ArmRepeatability, str]:
        """Repeatability, and whether any of it is stated or all assumed."""
        assumed = ArmRepeatability()
        position, evidence = _stated_or_assumed(self.repeatability, assumed.position)
        angle, of_angle = _stated_or_assumed(self.angular_repeatability, assumed.angle)
        stated = EVIDENCE_STATED in (evidence, of_angle)
        return ArmRepeatability(position, angle), EVIDENCE_STATED if stated else EVIDENCE_ASSUMED


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserUncertaintySettings(units.SettingsTable):
    """The table [laser.uncertainty]: how far the laser's profiles may be from the truth.

    Parameters
    ----------
    linearity : float, optional
        Largest deviation of the range over the window, as data sheets state it, metres;
        `ASSUMED_LASER_LINEARITY` if left out.
    range_bias : float, optional
        Standard deviation of the range's error at 45° of incidence, which grows with the
        tangent of the incidence, metres; `ASSUMED_LASER_RANGE_BIAS` if left out.
    """

    linearity: Annotated[float | None, Ge(0), Le(5), units.MM] = None
    range_bias: Annotated[float | None, Ge(0), Le(5), units.MM] = None

    @property
    def stated_linearity(self) -> tuple[float, str]:
        """Linearity in metres, and whether it is stated or assumed."""
        return _stated_or_assumed(self.linearity, ASSUMED_LASER_LINEARITY)

    @property
    def stated_bias(self) -> tuple[float, str]:
        """Range bias in metres, and whether it is stated or assumed."""
        return _stated_or_assumed(self.range_bias, ASSUMED_LASER_RANGE_BIAS)


def _stated_or_assumed(value: float | None, default: float) -> tuple[float, str]:
    return (default, EVIDENCE_ASSUMED) if value is None else (value, EVIDENCE_STATED)


@dataclass(frozen=True, kw_only=True)
class ArmSettings(DeviceSettings):
    """The table [arm]: which arm, and the bounds it moves within.

    Parameters
    ----------
    model : str
        A model that is known by name, or the path of a URDF.
    speed, acceleration : float
        Of the flange, m/s and m/s².
    shaper : InputShaper, optional
        Moves that do not let what carries the arm sway; of arms whose moves this program times.
    uncertainty : ArmUncertaintySettings
        How far it may be from where it reports.
    """

    registry: ClassVar[DriverRegistry[Any]] = ARM_DRIVERS

    model: str = "ur10e"
    speed: Annotated[float, Ge(1), Le(3000), units.MM_S] = 0.25
    acceleration: Annotated[float, Ge(10), Le(50_000), units.MM_S2] = 1.2
    shaper: InputShaper | None = None
    uncertainty: ArmUncertaintySettings = field(default_factory=ArmUncertaintySettings)

    @property
    def device_id(self) -> str:
        """Id of the arm in calibrations: its own id, or else its model."""
        return self.id or self.model


@dataclass(frozen=True, kw_only=True)
class LaserSettings(DeviceSettings):
    """The table [laser]: which line laser, and the window it measures in.

    Parameters
    ----------
    recording : str, optional
        What the driver "replay" takes its profiles from: a run directory, or a file of one. The
        arm's driver "replay" takes its poses from this recording too.
    replay_tolerance, replay_angle : float
        How far from a recorded pose the flange may be, metres and radians.
    points : int
        Points of a profile.
    near, far : float
        Limits of z in frame s, metres.
    uncertainty : LaserUncertaintySettings
        How far its profiles may be from the truth.
    """

    registry: ClassVar[DriverRegistry[Any]] = LASER_DRIVERS

    recording: Annotated[str | None, MinLen(1)] = None
    replay_tolerance: Annotated[float, Ge(0), Le(1000), units.MM] = 5e-3
    replay_angle: Annotated[float, Ge(0), Le(180), units.DEG.with_key("replay_tolerance_deg")] = (
        radians(2)
    )
    points: Annotated[int, Ge(160), Le(640), MultipleOf(80)] = 640
    near: Annotated[float, Ge(1), Le(5000), units.MM] = 0.190
    far: Annotated[float, Ge(1), Le(5000), units.MM] = 0.290
    uncertainty: LaserUncertaintySettings = field(default_factory=LaserUncertaintySettings)

    def __post_init__(self) -> None:
        if self.near >= self.far:
            raise ValueError(
                f"near_mm must be smaller than far_mm (found {1e3 * self.near:g} and "
                f"{1e3 * self.far:g}); swapped?"
            )
        if self.driver == "replay" and self.recording is None:
            raise ValueError('driver "replay" needs a recording: a run directory, or its scan.mcap')

    @property
    def device_id(self) -> str:
        """Id of the laser in calibrations: its own id, or its driver and serial number."""
        # Drivers of other packages have tables of their own.
        serial = getattr(self.driver_settings, "serial", None)
        return self.id or (self.driver if serial is None else f"{self.driver} {serial}")


@dataclass(frozen=True, kw_only=True)
class PowerSettings(DeviceSettings):
    """The table [power]: which power source feeds the arc."""

    registry: ClassVar[DriverRegistry[Any]] = POWER_DRIVERS

    @property
    def is_on_this_machine(self) -> bool:
        """Whether it melts no metal: it is simulated, or a stand-in that listens here."""
        if self.driver != "modbus":
            return self.driver_kind is DriverKind.SIMULATED
        return is_loopback_host(self.driver_settings.host)


@dataclass(frozen=True, kw_only=True)
class CarrierSettings(DeviceSettings):
    """The table [carrier]: what carries the arm, or the joint, from station to station.

    Parameters
    ----------
    carries : str
        ``arm``, or ``joint`` where it lies on a turn-table: frame w is fixed to the plate then.
    position, euler_zyx : tuple of float
        Pose of the arm's base in frame w while all axes are at 0, metres and radians.
    axis : tuple of AxisSettings
        Its axes, from the ground on.
    sigma, angular_sigma : float
        Standard deviations of where it stops, all directions together, metres and radians; 0 of
        one that is as exact as its encoders.
    home : tuple of float, optional
        Joint angles in which the arm is carried, radians; required from two stations on.
    """

    registry: ClassVar[DriverRegistry[Any]] = CARRIER_DRIVERS

    driver: str = "none"
    carries: Literal["arm", "joint"] = "arm"
    position: units.Position
    euler_zyx: units.EulerAngles
    axis: Annotated[tuple[AxisSettings, ...], MinLen(1), MaxLen(4), units.LIST_OR_WORD_IN_FILE]
    sigma: Annotated[float, Ge(0), Le(50), units.MM]
    angular_sigma: Annotated[float, Ge(0), Le(5), units.DEG.with_key("sigma_deg")]
    home: JointAngles | None = None

    def __post_init__(self) -> None:
        units.refuse_radians("home_deg", self.home or (), right=False)
        units.refuse_radians("euler_zyx_deg", self.euler_zyx, right=True)
        names = [axis.name.casefold() for axis in self.axis]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"axis: two axes are called {name!r}")
        simulated, known = self.drivers.get("simulated"), {axis.name for axis in self.axis}
        if unknown := set(simulated.reversed if simulated else ()) - known:
            raise ValueError(f"simulated.reversed: no axis is called {min(unknown)!r}")

    @property
    def kinematics(self) -> CarrierKinematics:
        """Where the base is by the values of the axes."""
        zero = pose_from_euler_zyx(self.position, self.euler_zyx)
        return CarrierKinematics(self.axis, zero, self.carries == "joint")

    def values_si(self, values: tuple[float, ...]) -> Array:
        """Values of the axes as a file has them, millimetres and degrees, in metres and radians.

        Raises
        ------
        ConfigurationError
            If they are of another number, or beyond the axes' limits.
        """
        pairs = zip(self.axis, values, strict=False)
        found = [axis.unit.to_si(value) for axis, value in pairs]
        self.kinematics.check_values(found if len(values) == len(self.axis) else values)
        return np.array(found)

    def values_in_file(self, values: Array) -> tuple[float, ...]:
        """Values of the axes as a file has them, to a micrometre and a microdegree."""
        pairs = zip(self.axis, values.tolist(), strict=True)
        return tuple(
            round(v / a.unit.factor, 3 if a.unit is units.MM else 6) + 0.0 for a, v in pairs
        )

    def true_T_w_b(self, values: Array, seed: int) -> Array:
        """Where the base truly is in a simulated world, shape (4, 4), metres."""
        if self.driver != "simulated":
            return self.kinematics.T_w_b(values)
        found: Array = self.driver_settings.true_T_w_b(self.kinematics, values, seed)
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationSettings(units.SettingsTable):
    """Pose of the laser on the flange: rows of T_f_s, or the calibration file that holds it.

    Parameters
    ----------
    T_f_s_mm : tuple of tuple of float, optional
        Its rows, millimetres.
    file : str, optional
        A calibration, sought from the job's folder.
    sigma_position, sigma_rotation : float, optional
        Standard deviations of `T_f_s_mm`, all directions together, metres and radians. A file
        brings its own.
    """

    T_f_s_mm: units.PoseRows | None = None
    file: str | None = None
    sigma_position: Annotated[float | None, Ge(0), Le(50), units.MM] = None
    sigma_rotation: Annotated[float | None, Ge(0), Le(20), units.DEG] = None

    def __post_init__(self) -> None:
        if (self.T_f_s_mm is None) == (self.file is None):
            raise ValueError("needs either T_f_s_mm or file, and not both")
        if (self.sigma_position is None) != (self.sigma_rotation is None):
            raise ValueError("sigma_position_mm and sigma_rotation_deg belong together")
        if self.file is not None and self.sigma_position is not None:
            raise ValueError("sigma_position_mm belongs to T_f_s_mm: a file holds its own")

    @property
    def T_f_s(self) -> Array | None:
        """Pose of the sensor in the flange frame, shape (4, 4), metres; None if a file holds it."""
        return None if self.T_f_s_mm is None else units.pose_from_rows_mm(self.T_f_s_mm)

    @property
    def covariance(self) -> Array | None:
        """Covariance of `T_f_s_mm`, shape (6, 6), metres and radians in axes of f, if stated."""
        if self.sigma_position is None or self.sigma_rotation is None:
            return None
        return np.diag(np.repeat(np.square((self.sigma_position, self.sigma_rotation)) / 3, 3))


def make_laser_without_arm(table: DeviceSettings) -> LineLaser:
    """Make a real laser that no arm carries: it is alone, or sits on a vehicle.

    Its profiles are timed by the monotonic clock of this machine.

    Parameters
    ----------
    table : DeviceSettings
        Which laser.

    Raises
    ------
    ConfigurationError
        If it is not a real one, or a package is missing that its driver needs.
    """
    if table.driver_kind is not DriverKind.REAL:
        raise ConfigurationError(f"{table.driver!r} is no real laser", key="laser.driver")
    flange = LaserFlange(_refuse_without_arm, _refuse_without_arm, monotonic)
    inputs = LaserDriverInputs(
        LaserModel(), flange, np.eye(4), _refuse_without_arm, None, _refuse_without_arm
    )
    laser: LineLaser = table.make_device(inputs)
    return laser


def _refuse_without_arm() -> Any:
    raise ConfigurationError(
        "this laser's driver asks for an arm's flange, and no arm carries the laser here: it needs "
        "a driver that takes profiles alone",
        key="laser.driver",
    )
