"""Drive: everything on the bench beside the machine's data sheet, the reference and the shaft."""

from dataclasses import dataclass, field

from penode.bench.inverter import Inverter
from penode.bench.sensors import CurrentSensors, Resolver, SpeedSensor
from penode.bench.winding import IronLoss, Winding


@dataclass(frozen=True)
class Drive:
    """Everything between the reference and the machine's iron. The default is ideal.

    Attributes
    ----------
    time_step : float
        Sampling, control and switching interval in s.
    dc_voltage : float
        Voltage of the dc link in V.
    bandwidth : float
        Bandwidth the current controller is tuned for in rad/s.
    tuning : float
        Inductance the controller believes over the data sheet's.
    current_noise : float
        Standard deviation in A of the white noise on each measured dq current.
    inverter : Inverter
        Hold, voltage limit, dead time, device drops, computation delay.
    current_sensors : CurrentSensors or None
        Sensors of the phase currents; None sees the true currents.
    resolver : Resolver or None
        Angle sensor; None sees the true angle.
    speed_sensor : SpeedSensor or None
        Speed signal; None sees the true speed.
    winding : Winding
        Temperature and balance of the machine's winding.
    iron_loss : IronLoss or None
        Iron loss of the machine.
    magnet_temperature : float or None
        Temperature of the magnets in degrees Celsius; None: the one the data sheet holds at.
    """

    time_step: float = 1e-4
    dc_voltage: float = 400.0
    bandwidth: float = 1000.0
    tuning: float = 0.8
    current_noise: float = 0.0
    inverter: Inverter = field(default_factory=Inverter)
    current_sensors: CurrentSensors | None = None
    resolver: Resolver | None = None
    speed_sensor: SpeedSensor | None = None
    winding: Winding = field(default_factory=Winding)
    iron_loss: IronLoss | None = None
    magnet_temperature: float | None = None


DEFAULT_DRIVE = Drive()
