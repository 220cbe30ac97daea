"""The rules of `mjrun check`, by subject. Each module in this package is searched for rules.

Most rules are functions of a model that loads, with the decorator `rule`. Others are constants of class `Rule`, whose
findings come from the XML, from an error of MuJoCo, from a simulation or from the process.
"""
