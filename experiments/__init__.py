"""What is asked: the command `run-experiment`, and the experiments that YAML alone cannot say.

the command   cli, arguments and commands; rehearsal is --dry-run, compare_runs --compare and
              own_scans --register; terminal and progress are what it prints
precision     chapter 3 on the simulated sensor, and its calibration by a user
profiles      section 6.2, profile by profile: profile_* and planar_figures
discussion    section 6.6: discussion_*, turned_rotation, icp_on_top
chapters      chapter 6 in one run: *chapters*, chapter_summary, chapter_figures, medians

Through `at_once` the command runs the three in the middle, each as a whole.
"""
