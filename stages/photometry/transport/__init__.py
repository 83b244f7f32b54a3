"""Light transport to surface points: visibility, irradiance and interreflection."""
