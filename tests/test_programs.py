"""Programs that are compiled quickly where they get few numbers."""

import jax.numpy as jnp
import numpy as np
import pytest

from penode import programs
from penode.programs import FEW, Program


def waves(count: int, x):
    return sum(jnp.sin(k * x) ** 2 for k in range(count))


@pytest.mark.parametrize(("size", "quick"), [(FEW, True), (FEW + 1, False)])
def test_few_numbers_are_compiled_quickly_and_give_the_same(size, quick):
    program, x = Program(waves, static_argnums=0), np.linspace(0.0, 1.0, size, dtype=np.float32)
    expected = sum(np.sin(k * x) ** 2 for k in range(3))
    np.testing.assert_allclose(program(3, x), expected, rtol=1e-5, atol=1e-6)
    assert program._quick._cache_size() == int(quick)
    assert program._thorough._cache_size() == int(not quick)
    program(3, 2 * x)
    assert program.compiled == 1
    program.clear_cache()
    assert program.compiled == 0


def test_the_options_are_those_of_few_numbers(monkeypatch):
    monkeypatch.setattr(programs, "_quick_options", lambda: {"xla_cpu_fuse_by_hand": True})
    program = Program(waves, static_argnums=0)
    with pytest.raises(RuntimeError, match="xla_cpu_fuse_by_hand"):
        program(2, np.zeros(3))
    assert program(2, np.zeros(FEW + 1)).shape == (FEW + 1,)


def test_an_option_that_xla_no_longer_knows_is_left_out(monkeypatch):
    programs._quick_options.cache_clear()
    monkeypatch.setattr(programs, "_QUICK", {"xla_cpu_fuse_by_hand": True})
    assert programs._quick_options() is None
    assert Program(waves, 0)(2, np.zeros(3)).shape == (3,)
    programs._quick_options.cache_clear()
    monkeypatch.undo()
    assert programs._quick_options() == programs._QUICK


def test_a_program_keeps_its_name():
    assert Program(waves, 0).__name__ == "waves"
