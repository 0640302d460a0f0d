"""Writes pca.toml beside this file: postures, and NumPy's analysis of them.

The postures are rounded to short decimals, so that the fixture stays small and every reader has the same numbers.
Run it with any Python 3 that has NumPy:  python3 generate_pca.py
"""

from pathlib import Path

import numpy as np

N_POSTURES, N_JOINTS, N_COMPONENTS, RANK = 60, 9, 5, 7
SIGN_TIE = 1e-9


def signed(component):
    """The sign rule: the first entry of the largest absolute value is positive."""
    size = np.abs(component)
    return component * np.sign(component[np.argmax(size >= size.max() * (1 - SIGN_TIE))])


def numbers(values):
    return "[" + ", ".join(repr(float(v)) for v in values) + "]"


def matrix(rows):
    return "[\n" + "".join("    " + numbers(row) + ",\n" for row in rows) + "]"


rng = np.random.default_rng(20240517)
scale = np.linspace(1.0, 0.1, RANK)
postures = rng.normal(size=(N_POSTURES, RANK)) * scale @ rng.normal(size=(RANK, N_JOINTS)) / 2
postures = np.round(postures + rng.uniform(-0.5, 1.5, N_JOINTS) + rng.normal(0, 0.02, postures.shape), 3)

mean = postures.mean(axis=0)
covariance = np.cov(postures, rowvar=False)
eigenvalues, vectors = np.linalg.eigh(covariance)
eigenvalues, vectors = eigenvalues[::-1], vectors[:, ::-1]
components = np.array([signed(vectors[:, i]) for i in range(N_COMPONENTS)])
coefficients = (postures - mean) @ components.T
residuals = postures - mean - coefficients @ components

text = f"""# Written by generate_pca.py with NumPy {np.__version__}.
k = {N_COMPONENTS}
postures = {matrix(postures)}
mean = {numbers(mean)}
eigenvalues = {numbers(eigenvalues)}
components = {matrix(components)}
contribution = {numbers(eigenvalues[:N_COMPONENTS] / eigenvalues.sum())}
coefficient_min = {numbers(coefficients.min(axis=0))}
coefficient_max = {numbers(coefficients.max(axis=0))}
errors = {numbers(np.linalg.norm(residuals, axis=1))}
"""
Path(__file__).with_name("pca.toml").write_text(text)
