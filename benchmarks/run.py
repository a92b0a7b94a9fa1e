"""Run the benchmarks that need no more than the development environment: ``make bench``.

Four more need torch, CasADi or jax-sysid, in an environment of their own; their commands are
printed last.
"""

from benchmarks import (
    bench_speed,
    c_lookup,
    diffrax_gradient,
    gauss_newton,
    identification,
    memory,
    parallel_starts,
    roofline,
    start,
)

HERE = (
    roofline,
    gauss_newton,
    diffrax_gradient,
    memory,
    identification,
    bench_speed,
    parallel_starts,
    c_lookup,
    start,
)

ELSEWHERE = """\
Not run here:

  python3 -m venv bench-env
  bench-env/bin/pip install -c constraints.txt -e '.[dev]' -r benchmarks/requirements.txt
  taskset -c 0 bench-env/bin/python -m benchmarks.torchdiffeq_gradient
  taskset -c 0 bench-env/bin/python -m benchmarks.time_to_accuracy
  bench-env/bin/python -m benchmarks.peers

  bench-env/bin/pip install --no-deps jax-sysid==1.1.0 jaxopt==0.8.5
  bench-env/bin/pip install -c constraints.txt flax joblib cloudpickle
  taskset -c 0 bench-env/bin/python -m benchmarks.jax_sysid_fit"""

if __name__ == "__main__":
    for benchmark in HERE:
        print(f"\n== {benchmark.__name__.removeprefix('benchmarks.')}")
        benchmark.main()
    print(f"\n{ELSEWHERE}")
