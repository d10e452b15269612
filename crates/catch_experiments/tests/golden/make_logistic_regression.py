"""Logistic regressions with a ridge: writes logistic_regression.json. Needs NumPy, SciPy and scikit-learn."""

import json

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit
from sklearn.linear_model import LogisticRegression

rng = np.random.default_rng(1)


def draws(count, truth, intercept):
    X = rng.normal(size=(count, len(truth)))
    y = (rng.uniform(size=count) < expit(X @ truth + intercept)).astype(float)
    return X, y


def record(name, X, y, ridge, is_at_most_zero, beta):
    fields = ["name", "X", "y", "ridge", "is_at_most_zero", "beta"]
    values = [name, X.tolist(), y.tolist(), list(ridge), list(is_at_most_zero), list(beta)]
    return dict(zip(fields, values))


def with_scikit_learn(name, ridge):
    """All coefficients free; the intercept, the last column, has no ridge."""
    X, y = draws(120, np.array([1.2, -0.8, 0.1]), 0.4)
    X = np.round(X, 4)
    model = LogisticRegression(C=1.0 / ridge, solver="newton-cholesky", tol=1e-12, max_iter=1000).fit(X, y)
    beta = [*model.coef_[0], model.intercept_[0]]
    X = np.column_stack([X, np.ones(len(X))])
    return record(name, X, y, [ridge] * 3 + [0.0], [False] * 4, beta)


def with_scipy(name):
    """Some coefficients at most zero, those of two of them held there; two intercepts."""
    X, y = draws(150, np.array([-1.5, 0.6, -0.3, 0.9]), 0.2)
    group = rng.integers(0, 2, size=len(X))
    X = np.column_stack([np.round(X, 4), group == 0, group == 1]).astype(float)
    ridge = np.array([1.0, 1.0, 0.5, 2.0, 0.1, 0.1])
    is_at_most_zero = [True, True, True, True, False, False]

    def objective(beta):
        z = X @ beta
        value = np.sum(np.logaddexp(0.0, z) - y * z) + 0.5 * np.sum(ridge * beta**2)
        return value, X.T @ (expit(z) - y) + ridge * beta

    bounds = [(None, 0.0) if it else (None, None) for it in is_at_most_zero]
    options = {"ftol": 1e-16, "gtol": 1e-10, "maxiter": 10000}
    found = minimize(objective, np.zeros(6), jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    return record(name, X, y, ridge.tolist(), is_at_most_zero, found.x.tolist())


cases = [
    with_scikit_learn("a small ridge", 0.1),
    with_scikit_learn("a large ridge", 20.0),
    with_scipy("bounds and two intercepts"),
]
with open("logistic_regression.json", "w") as file:
    json.dump(cases, file)
    file.write("\n")
