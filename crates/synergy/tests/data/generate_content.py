"""Writes content.toml beside this file: labelled postures, and scikit-learn's and NumPy's analysis of them.

Run it with any Python 3 that has scikit-learn:  python3 generate_content.py
"""

from pathlib import Path

import numpy as np
import sklearn
from sklearn.decomposition import PCA
from sklearn.metrics import balanced_accuracy_score
from sklearn.neighbors import NearestCentroid

FOLDS, K = 10, 2
COUNTS = {"sphere": 24, "cube": 13, "disc": 17, "pen": 7}  # too few pens: they are not named
N_NUMBERS, JOINTS = 6, [4, 0, 1, 3, 5]  # number 2 is the slide

rng = np.random.default_rng(20240518)
names = rng.permutation(np.repeat(list(COUNTS), list(COUNTS.values())))
place = {name: rng.normal(0, 0.5, N_NUMBERS) for name in COUNTS}
mixing = rng.normal(0, 0.35, (N_NUMBERS, N_NUMBERS))
postures = np.array([place[name] for name in names]) + rng.normal(size=(len(names), N_NUMBERS)) @ mixing
postures[:, 2] = 9 * rng.normal(size=len(names))
postures = np.round(postures, 3)

order = np.argsort(names, kind="stable")
q, y = postures[order][:, JOINTS], names[order]
eigenvalues = np.linalg.eigvalsh(np.cov(q, rowvar=False))
groups = [q[y == name] for name in np.unique(y)]
between = sum(len(g) * np.sum((g.mean(axis=0) - q.mean(axis=0)) ** 2) for g in groups)
within = sum(np.sum((g - g.mean(axis=0)) ** 2) for g in groups)
n, n_groups = len(q), len(groups)
# Epsilon squared in the form of Kelley: the mean square within the groups corrects the sum between them.
adjusted = (between - (n_groups - 1) * within / (n - n_groups)) / (between + within)

inside = total = 0.0
for fold in range(FOLDS):
    held = np.arange(n) % FOLDS == fold
    pca = PCA(K, svd_solver="full").fit(q[~held])
    inside += np.sum(pca.transform(q[held]) ** 2)
    total += np.sum((q[held] - pca.mean_) ** 2)

named = np.array([np.sum(y == name) >= FOLDS for name in y])
q, y = q[named], y[named]
found = np.empty_like(y)
for fold in range(FOLDS):
    held = np.arange(len(q)) % FOLDS == fold
    pca = PCA(K, svd_solver="full").fit(q[~held])
    found[held] = NearestCentroid().fit(pca.transform(q[~held]), y[~held]).predict(pca.transform(q[held]))

rows = "".join(f'    ["{name}", {[float(x) for x in row]}],\n' for name, row in zip(names, postures))
text = f"""# Written by generate_content.py with NumPy {np.__version__} and scikit-learn {sklearn.__version__}.
k = {K}
joints = {JOINTS}
total_variance = {float(eigenvalues.sum())!r}
between_objects = {float(between / (between + within))!r}
between_objects_adjusted = {float(adjusted)!r}
participation_ratio = {float(eigenvalues.sum() ** 2 / np.sum(eigenvalues**2))!r}
naming_accuracy = {float(balanced_accuracy_score(y, found))!r}
held_out_contribution = {float(inside / total)!r}
postures = [
{rows}]
"""
Path(__file__).with_name("content.toml").write_text(text)
