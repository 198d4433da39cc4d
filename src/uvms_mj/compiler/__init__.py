"""The compiler: Python functions of numbers, records and arrays of known shape in, LLVM out.

It knows nothing of vehicles, stages or the loop. docs/inside/language.md is its language. :mod:`.unit` is the entrance.

- :mod:`.values`: kinds of values and the LLVM values that represent them
- :mod:`.refusals`: what is refused, with file, line and the words of the source; why and where a function ended early
- :mod:`.emission`: settings, constants and files of a module; memory, loops and checks of one function
- :mod:`.scalars`: arithmetic of numbers
- :mod:`.arrays`: arithmetic of arrays, element by element, products and reductions; fields, entries, rows and slices
- :mod:`.known`: objects that are known when compiling, and the constants that they become
- :mod:`.forms`: texts, lists, dicts, comprehensions and functions within functions
- :mod:`.expressions`: expressions and calls
- :mod:`.calls`: which function has which writer, and how its arguments are read
- :mod:`.shapes`: the functions of NumPy that put numbers into another shape or order
- :mod:`.reductions`: sums, means, extremes, orders
- :mod:`.matrices`: products, norms and linear equations
- :mod:`.builtin`: all other functions of Python, ``math`` and NumPy that are part of the language
- :mod:`.library`: functions written in the language itself, such as the solution of linear equations
- :mod:`.libm`: exp, sin and their like, written in the language, with the same bits on every processor
- :mod:`.cells`: a record whose numbers are known when compiling, or in registers
- :mod:`.lifetimes`: which memory an array has that a loop makes at each turn
- :mod:`.tree_facts`: facts about a function that its tree tells before it is translated
- :mod:`.assignments`: statements that bind a name or store
- :mod:`.function`: all other statements, and the whole function
- :mod:`.unit`: the translation of several functions to one module
- :mod:`.targets`: its machine code, also for other processors
- :mod:`.apart`: LLVM in a process of its own
"""
