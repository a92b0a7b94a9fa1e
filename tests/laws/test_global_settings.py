"""penode computes in float64 and leaves JAX's global settings as they are."""

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


def test_importing_changes_no_setting():
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_float64_is_a_scope():
    with float64():
        assert jnp.zeros(1).dtype == jnp.float64
    assert jnp.zeros(1).dtype == jnp.float32


def test_a_whole_identification_leaves_the_settings(oscillator):
    assert oscillator.fit.parameters["mass"].value > 0
    assert jax.config.jax_enable_x64 is False
    assert jnp.zeros(1).dtype == jnp.float32
