"""penode computes in float64 and leaves JAX's global settings as they are."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp

from penode.arrays import float64

SCRIPT = """
import jax
before = dict(jax.config.values)
import penode, penode.cli.main
after = dict(jax.config.values)
assert before == after, {k: (before[k], after[k]) for k in before if before[k] != after[k]}
assert jax.config.jax_enable_x64 is False
"""


# Prints how many loops of a large step are functions of their own.
LOOPS = """
import os
from penode.arrays import float64
before = dict(os.environ)
with float64():
    import jax, jax.numpy as jnp
    def step(k, x):
        return x * jnp.cos(jnp.roll(x, 1)) + k
    loop = jax.jit(lambda x: jax.lax.fori_loop(0, 100, step, x))
    print(loop.lower(jnp.ones(1000)).compile().as_text().count("xla_cpu_small_call"))
assert dict(os.environ) == before
"""


def printed(script, **environment):
    plain = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=False,
        env={**plain, **environment},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_importing_changes_no_setting():
    printed(SCRIPT)


def test_loops_are_functions_and_the_environment_stays():
    assert int(printed(LOOPS)) > 0


def test_what_the_environment_says_of_loops_goes_first():
    own = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=0"
    assert int(printed(LOOPS, XLA_FLAGS=own)) == 0
    other = "--xla_cpu_enable_fast_math=false"
    assert int(printed(LOOPS, XLA_FLAGS=other)) > 0


def test_float64_is_a_scope():
    with float64():
        assert jnp.zeros(1).dtype == jnp.float64
    assert jnp.zeros(1).dtype == jnp.float32


def test_a_whole_identification_leaves_the_settings(oscillator):
    assert oscillator.fit.parameters["mass"].value > 0
    assert jax.config.jax_enable_x64 is False
    assert jnp.zeros(1).dtype == jnp.float32
