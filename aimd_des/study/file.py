def read_study(path, settings=None):
    import tomllib
    from aimd_des.study.design import Study
    return Study.model_validate(tomllib.loads(path.read_text()))
