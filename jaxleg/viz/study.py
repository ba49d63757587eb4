def draw_study(study, robot, folder, result): pass
