"""Archives of named arrays: HDF5, MATLAB and NumPy files."""
