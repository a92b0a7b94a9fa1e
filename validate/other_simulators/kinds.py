"""The kinds of recordings: how the drive runs, what its log contains, what is wrong with it."""

from dataclasses import dataclass, field

from validate.other_simulators.machines import GEM, MOTULATOR

BOTH = (MOTULATOR, GEM)


@dataclass(frozen=True)
class Kind:
    """How recordings of a kind are made.

    Attributes
    ----------
    name : str
    speeds : tuple of float
        Range of the speed as a fraction of the machine's base speed; its sign is drawn.
    sign : int
        Of the speed; 0 draws it.
    voltage : str
        ``"applied"`` in the sample, averaged over it and without dead time, or ``"command"`` of
        the controller, which acts a sample later and is not limited.
    reference : str
        A key of `references.REFERENCES`.
    profile : str
        A key of `references.PROFILES`.
    duration : float
        In s.
    simulators : tuple of str
    drive : mapping of str to float
        What the drive or its sensors do: ``dead_time`` (s), ``warming`` (fraction of R by the
        end), ``core_loss`` (fraction of the current that the iron takes at the link voltage),
        ``gain``, ``gain_b`` and ``offset_b`` (of all phases, of phase b; the offset as a fraction
        of the current), ``colour`` (correlation of the noise from sample to sample), ``bits``,
        ``pwm``, ``weak`` (fraction of samples whose voltage the link cannot supply).
    wrong : str
        A key of `wrong_logs.WRONG`: what is wrong with the log alone; empty for nothing.
    """

    name: str
    speeds: tuple[float, float] = (0.15, 0.5)
    sign: int = 0
    voltage: str = "applied"
    reference: str = "wander"
    profile: str = "constant"
    duration: float = 1.2
    simulators: tuple[str, ...] = BOTH
    drive: dict[str, float] = field(default_factory=dict)
    wrong: str = ""


KINDS = (
    Kind("clean, low speed", speeds=(0.03, 0.08), sign=1),
    Kind("clean, medium speed", speeds=(0.3, 0.5), sign=1),
    Kind("clean, high speed", speeds=(0.65, 0.85), sign=1),
    Kind("clean, negative speed", speeds=(0.2, 0.6), sign=-1),
    Kind("clean, speed ramp", speeds=(0.3, 0.6), profile="ramp"),
    Kind("two recordings, two speeds", profile="two"),
    Kind("0.1 s", duration=0.1),
    Kind("i_d = 0 only", reference="only q"),
    Kind("generator", speeds=(0.3, 0.6), reference="generator"),
    Kind("command, one sample early", voltage="command"),
    Kind(
        "command in field weakening",
        speeds=(0.8, 1.1),
        voltage="command",
        drive={"weak": 0.25},
    ),
    Kind("torque steps on a ramp", voltage="command", reference="steps", profile="ramp"),
    Kind("standstill", speeds=(0.0, 0.0)),
    Kind("dead time", drive={"dead_time": 1.5e-6}),
    Kind("PWM ripple", simulators=(MOTULATOR,), drive={"pwm": 1}),
    Kind("R warms by 10 to 25 %", drive={"warming": 1}),
    Kind("core loss", simulators=(MOTULATOR,), drive={"core_loss": 0.01}),
    Kind("coloured current noise", drive={"colour": 0.9}),
    Kind("12 bit currents", drive={"bits": 12}),
    Kind("currents 1 % too large", drive={"gain": 1.01}),
    Kind("phase b 1 % too large", drive={"gain_b": 1.01}),
    Kind("phase b offset by 1 %", drive={"offset_b": 0.01}),
    Kind("voltages 1 % too large", wrong="voltage gain"),
    Kind("speed lags at 5 Hz", profile="swing", wrong="lag"),
    Kind("speed reversed", wrong="reversed"),
    Kind("shaft's speed as electrical", wrong="shaft"),
    Kind("angle off by 2 degrees", wrong="angle"),
    Kind("per unit", wrong="per unit"),
    Kind("one sample of 1e6 A", wrong="spike"),
    Kind("noise alone", wrong="noise"),
)
