"""The forty kinds: 24 whose model is the plant, and 16 plants that have more than the model."""

from validate.physics import electrical, living, mechanical, process
from validate.physics.kind import Kind
from validate.physics.misfits import Appendage, Delay, Friction, Lag, Resonance, Saturation, Store

WELL: tuple[Kind, ...] = (
    mechanical.PENDULUM,
    mechanical.PENDULUM_ANGLE,
    mechanical.TWO_MASS,
    mechanical.THREE_MASS,
    mechanical.DUFFING,
    mechanical.QUARTER_CAR,
    mechanical.CRANE,
    mechanical.HYDRAULIC_CYLINDER,
    electrical.DC_MOTOR,
    electrical.DC_MOTOR_COARSE,
    electrical.BOOST_CONVERTER,
    electrical.RLC_LADDER,
    electrical.BATTERY,
    process.THREE_TANKS,
    process.THERMAL_FOUR,
    process.THERMAL_SIX,
    process.CSTR_TEMPERATURE,
    process.MICHAELIS_MENTEN,
    living.LOTKA_VOLTERRA,
    living.PREDATOR_PREY,
    living.SIR,
    living.GLUCOSE,
    living.FITZHUGH_NAGUMO,
    living.VAN_DER_POL,
)

#: Friction is some 5 % of what drives, a delay 1 to 2 samples, a mode several times as fast as the
#: model's own, a limit half of what the input would reach.
MISFITTING: tuple[Kind, ...] = (
    mechanical.PENDULUM.variant("pendulum_friction", misfit=Friction(0, 1, 0.4, 0.02)),
    mechanical.TWO_MASS.variant("two_mass_friction", misfit=Friction(0, 0, 20.0, 0.5)),
    mechanical.CRANE.variant("crane_friction", misfit=Friction(0, 2, 0.2, 0.01)),
    electrical.DC_MOTOR.variant("dc_motor_friction", misfit=Friction(0, 1, 100.0, 1.0)),
    mechanical.DUFFING.variant("duffing_delay", misfit=Delay(0, 1.0)),
    electrical.BOOST_CONVERTER.variant("boost_delay", misfit=Delay(0, 1.0)),
    process.THREE_TANKS.variant("three_tanks_delay", misfit=Delay(0, 2.0)),
    process.THERMAL_FOUR.variant("thermal_four_delay", misfit=Delay(0, 2.0)),
    mechanical.PENDULUM_ANGLE.variant("pendulum_mode", misfit=Resonance(2, 40.0, 0.1)),
    mechanical.QUARTER_CAR.variant("quarter_car_mode", misfit=Appendage(2, 0, 2, 0.2, 25.0, 0.2)),
    electrical.BATTERY.variant("battery_mode", misfit=Store(1, 0, 0.2, 0.02)),
    process.CSTR.variant("cstr_mode", misfit=Lag(1, 10.0, 310.0)),
    mechanical.DUFFING.variant("duffing_limit", misfit=Saturation(0, -2.0, 2.0)),
    electrical.DC_MOTOR.variant("dc_motor_limit", misfit=Saturation(0, -9.0, 9.0)),
    process.THREE_TANKS.variant("three_tanks_limit", misfit=Saturation(0, 1.0, 4.0)),
    living.GLUCOSE.variant("glucose_limit", misfit=Saturation(0, 0.0, 8.0)),
)

KINDS: dict[str, Kind] = {kind.name: kind for kind in (*WELL, *MISFITTING)}
