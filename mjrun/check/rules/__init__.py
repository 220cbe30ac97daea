"""The rules of `mjrun check`, by subject. Every module here is searched for rules; nothing else needs to know of it.

Most rules are a function of a model that loads, with the decorator `rule`. Others are constants of class `Rule`, whose
findings come from elsewhere: from the XML, from an error of MuJoCo, from a simulation or from the process.
"""
