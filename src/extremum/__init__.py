"""Extremum seeking control: describe a loop once, in equations; everything else is a reading of it.

>>> import extremum as es
>>> from extremum import s, pi
>>> loop = es.Loop(
...     field=es.Quadratic(source=(-1, -1), q=(1.0, 0.5), peak=1.0),
...     vehicle=es.PointMass(axes=(1/s, 1/s)),
...     controller=es.GradientES(
...         frequency=30, washout=1.0,
...         channels=(
...             es.Channel(dither=es.Dither(0.08), gain=10),
...             es.Channel(dither=es.Dither(0.08, phase=-pi/2), gain=10),
...         )),
...     start=(1, 1),
... )
>>> run = es.simulate(loop, 4.0)
>>> run.attrs["outcome"]
'completed'
>>> es.stability(loop).stable
True
"""

from __future__ import annotations

from . import plots
from .controllers import Channel, Controller, Dither, Excitation, GradientES, Probe, Reference
from .deploy.discrete import DiscreteController, discretize
from .deploy.exporting import export_c
from .deploy.realtime import RealtimeFailure, run_realtime
from .deploy.running import RealtimeReport
from .ensembles import ensemble
from .errors import InvalidDescription
from .fields import (
    Expression,
    Field,
    Gaussian,
    InverseSquare,
    Moving,
    Opaque,
    Quadratic,
    field_from,
)
from .gridded import Grid, Gridded
from .loop import Loop
from .lti import Lead, Rational, Transfer, TransferFunction
from .parameters import Parameter
from .paths import Along, Circle, FigureEight, Line, Path
from .requirements import (
    Periodic,
    Ramp,
    Requirements,
    SourceMotion,
    format_requirements,
    load_requirements,
    parse_requirements,
)
from .sampled.actuators import Actuator
from .sampled.adapting import Changes, Detector, ShrinkingDither
from .sampled.limits import Limits
from .sampled.loop import SampledLoop
from .sampled.practice import Practice
from .sampled.sampling import Sampling
from .sampled.scaling import LogScale, RunningScale, Scale
from .sampled.sensors import TGS2600, TGS2611, TGS2620, ColouredNoise, Lag, Sensor
from .sampled.simulating import simulate_sampled
from .sampled.validity import Validity
from .scenario import Run, Scenario, View, format_scenario, load_scenario, parse_scenario
from .simulation import simulate
from .starts import InState, OnDither, Start
from .sweeps import Axis, Study, Sweep, format_study, load_study, parse_study, sweep
from .symbols import (
    acos,
    acosh,
    asin,
    asinh,
    atan,
    atan2,
    atanh,
    cos,
    cosh,
    exp,
    log,
    pi,
    s,
    sin,
    sinh,
    sqrt,
    t,
    tan,
    tanh,
)
from .system import System
from .theory import (
    Assignment,
    Average,
    Bias,
    Collision,
    Condition,
    Critical,
    Design,
    FrequencyCheck,
    Infeasible,
    LoopGain,
    Lyapunov,
    Margins,
    NoiseVariance,
    Orbit,
    Rule,
    SampledCrossing,
    SampledLoopGain,
    ShrinkingCheck,
    StabilityLimit,
    Verdict,
    assign_frequencies,
    average,
    bias,
    check_frequencies,
    check_shrinking,
    critical_delay,
    critical_dt,
    critical_frequency,
    design,
    loop_gain,
    lyapunov,
    noise_variance,
    periodic_orbit,
    sampled_loop_gain,
    stability,
)
from .vehicles import PointMass, Vehicle

__version__ = "0.1.0"

__all__ = [
    "TGS2600",
    "TGS2611",
    "TGS2620",
    "Actuator",
    "Along",
    "Assignment",
    "Average",
    "Axis",
    "Bias",
    "Changes",
    "Channel",
    "Circle",
    "Collision",
    "ColouredNoise",
    "Condition",
    "Controller",
    "Critical",
    "Design",
    "Detector",
    "DiscreteController",
    "Dither",
    "Excitation",
    "Expression",
    "Field",
    "FigureEight",
    "FrequencyCheck",
    "Gaussian",
    "GradientES",
    "Grid",
    "Gridded",
    "InState",
    "Infeasible",
    "InvalidDescription",
    "InverseSquare",
    "Lag",
    "Lead",
    "Limits",
    "Line",
    "LogScale",
    "Loop",
    "LoopGain",
    "Lyapunov",
    "Margins",
    "Moving",
    "NoiseVariance",
    "OnDither",
    "Opaque",
    "Orbit",
    "Parameter",
    "Path",
    "Periodic",
    "PointMass",
    "Practice",
    "Probe",
    "Quadratic",
    "Ramp",
    "Rational",
    "RealtimeFailure",
    "RealtimeReport",
    "Reference",
    "Requirements",
    "Rule",
    "Run",
    "RunningScale",
    "SampledCrossing",
    "SampledLoop",
    "SampledLoopGain",
    "Sampling",
    "Scale",
    "Scenario",
    "Sensor",
    "ShrinkingCheck",
    "ShrinkingDither",
    "SourceMotion",
    "StabilityLimit",
    "Start",
    "Study",
    "Sweep",
    "System",
    "Transfer",
    "TransferFunction",
    "Validity",
    "Vehicle",
    "Verdict",
    "View",
    "__version__",
    "acos",
    "acosh",
    "asin",
    "asinh",
    "assign_frequencies",
    "atan",
    "atan2",
    "atanh",
    "average",
    "bias",
    "check_frequencies",
    "check_shrinking",
    "cos",
    "cosh",
    "critical_delay",
    "critical_dt",
    "critical_frequency",
    "design",
    "discretize",
    "ensemble",
    "exp",
    "export_c",
    "field_from",
    "format_requirements",
    "format_scenario",
    "format_study",
    "load_requirements",
    "load_scenario",
    "load_study",
    "log",
    "loop_gain",
    "lyapunov",
    "noise_variance",
    "parse_requirements",
    "parse_scenario",
    "parse_study",
    "periodic_orbit",
    "pi",
    "plots",
    "run_realtime",
    "s",
    "sampled_loop_gain",
    "simulate",
    "simulate_sampled",
    "sin",
    "sinh",
    "sqrt",
    "stability",
    "sweep",
    "t",
    "tan",
    "tanh",
]
