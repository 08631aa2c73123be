"""Would the tests notice if the estimation core were wrong?

``python -m benchmarks.mutation`` breaks one thing at a time in ``sensors``, ``registration``,
``sonar`` and ``evaluation`` (a sign, a comparison, a constant, a condition) and runs the unit tests
that mirror the package. A mutant that no test fails on has survived.

The mutants are cosmic-ray's, taken from it as from a library; neither tool fits as a whole:

- mutmut 3 leaves out decorated functions, so all of the numba kernels and every property, and
  constants outside functions;
- cosmic-ray changes the files of the working tree themselves, and starts an interpreter a mutant,
  which imports GTSAM, Open3D and numba for seconds before the first test.

Here a mutant lives in the memory of a forked process alone (``trials``), and a seeded sample is
drawn (``mutants``): all the mutants would take days.

What only the type checker reads is no mutant, nor is what floats refuse at once (``<<`` for ``*``).
A mutant whose tests take far too long is killed like one that fails; what the tests start as
processes of their own sees the module as it is.

It needs the extra ``mutation`` (``pip install -e '.[test,mutation]'``).
"""
