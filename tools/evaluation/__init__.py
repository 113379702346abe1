"""The experiments of the paper's section 4, with the rivals that users have: what `panchroma
evaluate` runs.
"""
