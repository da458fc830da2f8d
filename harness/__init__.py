"""How experiments are run: from a config to its rows, tables, figures and page.

config    what an experiment's file may say, read and checked
trials    the experiment as frozen trials: views, random pairs, the points of a sweep
scoring   how far estimates are from the truth, and how near they could be
store     the rows, one a trial, kept as trials end
workers   the processes, here or elsewhere, that perform trials
tables    what the rows say, as tables
figures   what pairs and experiments look like
studies   what the accuracy depends on, with a conclusion
report    all of it on one page

`session` leads an experiment from its file to its folder, `execution` a trial from its spec to its
row, `provenance` says which code computed it, `results` where all of it lies, and `recent` keeps
what was costly to make.
"""
