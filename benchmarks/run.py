"""Run every benchmark: ``make bench``."""

from benchmarks import gauss_newton, identification

if __name__ == "__main__":
    gauss_newton.main()
    identification.main()
