"""How many evaluations pycma takes to the target on its standard test functions: tests/data/pycma.csv.

  python3 ident/scripts/pycma_reference.py > ident/tests/data/pycma.csv     (needs cma and numpy)

Every run starts at 3 in each coordinate with step 2 (Rosenbrock: at 0 with step 0.5) and counts
evaluations until a loss of 1e-8. Median and quartiles are over the successful ones of the seeds 1..RUNS."""
import cma
import numpy as np

TARGET, RUNS, CAP = 1e-8, 51, 200_000


def scale(n, power):
    return 10.0 ** (power * np.arange(n) / (n - 1))


FUNCTIONS = {
    "sphere": lambda x: float(x @ x),
    "ellipsoid": lambda x: float(scale(len(x), 6) @ x**2),
    "cigar": lambda x: float(x[0] ** 2 + 1e6 * (x[1:] @ x[1:])),
    "discus": lambda x: float(1e6 * x[0] ** 2 + x[1:] @ x[1:]),
    "rosenbrock": lambda x: float(np.sum(100 * (x[:-1] ** 2 - x[1:]) ** 2 + (x[:-1] - 1) ** 2)),
    "different_powers": lambda x: float(np.sum(np.abs(x) ** (2 + 10 * np.arange(len(x)) / (len(x) - 1)))),
    "rastrigin": lambda x: float(10 * len(x) + np.sum(x**2 - 10 * np.cos(2 * np.pi * x))),
}
CASES = [(name, n, 0) for name in FUNCTIONS if name != "rastrigin" for n in (5, 10, 20)] + [("rastrigin", 5, 100)]


def evaluations(name, n, population, seed):
    start, sigma = (0.0, 0.5) if name == "rosenbrock" else (3.0, 2.0)
    options = {"ftarget": TARGET, "maxfevals": CAP, "seed": seed, "verbose": -9, "tolfun": 0, "tolfunhist": 0,
               "tolx": 0, "tolflatfitness": CAP, "tolstagnation": 0, "tolconditioncov": 0}
    if population:
        options |= {"popsize": population, "tolfun": 1e-11, "tolfunhist": 1e-12}
    es = cma.CMAEvolutionStrategy(np.full(n, start), sigma, options)
    while not es.stop():
        points = es.ask()
        es.tell(points, [FUNCTIONS[name](np.asarray(x)) for x in points])
    return es.countevals if es.best.f <= TARGET else None


print("function,dimension,population,runs,successes,quartile1,median,quartile3")
for name, n, population in CASES:
    counts = [evaluations(name, n, population, seed) for seed in range(1, RUNS + 1)]
    hits = [c for c in counts if c is not None]
    q1, q2, q3 = np.percentile(hits, [25, 50, 75]) if hits else (0, 0, 0)
    print(f"{name},{n},{population},{RUNS},{len(hits)},{q1:.0f},{q2:.0f},{q3:.0f}", flush=True)
