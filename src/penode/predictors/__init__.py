"""Predictors: solvers that turn a model into the map from one sample to the next."""
