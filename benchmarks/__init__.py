"""Benchmark suite of jaxnc: ``python -m benchmarks``.

Times are never compared with a stored time, only ratios of times of one run. Every time stands beside the fraction of
lanes that are right, which is counted against a closed form or an independent solution, branch included.
"""
