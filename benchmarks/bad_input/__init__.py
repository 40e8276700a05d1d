"""Bad input for every command: files, options, outputs and run folders that must be refused in one sentence.

Cases live in one module per kind of input; the runner is ``python -m benchmarks.bad_input``.
"""
