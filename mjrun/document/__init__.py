"""Documents: conversion of YAML files to typed values, with every error at its line and column."""
