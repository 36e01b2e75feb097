// SPDX-License-Identifier: Apache-2.0
#include "frontend/place_recognition.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bitset>
#include <random>
#include <string>

#include "frontend/vocabulary_thermal.h"
#include "frontend/vocabulary_training.h"
#include "frontend/vocabulary_visual.h"
#include "synthetic_places.h"

namespace covey {
namespace {

using testing::random_descriptor;
using testing::with_noise;

using Descriptors = std::vector<BinaryDescriptor>;

Descriptors random_descriptors(int count, unsigned seed) {
  std::mt19937 random(seed);
  Descriptors descriptors;
  for (int i = 0; i < count; ++i) descriptors.push_back(random_descriptor(random));
  return descriptors;
}

BinaryDescriptor filled(std::uint8_t byte) {
  BinaryDescriptor descriptor;
  descriptor.fill(byte);
  return descriptor;
}

TEST(HammingDistance, CountsTheBitsThatDiffer) {
  std::mt19937 random(3);
  for (int i = 0; i < 100; ++i) {
    const BinaryDescriptor a = random_descriptor(random), b = random_descriptor(random);
    int expected = 0;
    for (std::size_t k = 0; k < a.size(); ++k) {
      expected += static_cast<int>(std::bitset<8>(a[k] ^ b[k]).count());
    }
    EXPECT_EQ(hamming_distance(a, b), expected);
  }
  EXPECT_EQ(hamming_distance(filled(0x00), filled(0xff)), 256);
}

TEST(Vocabulary, SurvivesItsText) {
  const Vocabulary vocabulary{random_descriptors(5, 1)};
  EXPECT_EQ(parse_vocabulary(to_text(vocabulary)).words, vocabulary.words);
}

TEST(Vocabulary, NamesTheLineThatIsWrong) {
  const std::string good = to_text({random_descriptors(2, 1)});
  const auto message_of = [](const std::string& text) -> std::string {
    try {
      (void)parse_vocabulary(text);
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "no error";
  };
  EXPECT_NE(message_of(good + "12ab\n").find("line 3: 4 characters"), std::string::npos);
  EXPECT_NE(message_of(good + std::string(64, 'x')).find("line 3: not a hex digit"),
            std::string::npos);
  EXPECT_NE(message_of("").find("no words"), std::string::npos);
}

TEST(Vocabulary, ShippedOnesHaveSixtyFourDifferentWords) {
  for (const Vocabulary& vocabulary : {visual_vocabulary(), thermal_vocabulary()}) {
    Descriptors words = vocabulary.words;
    EXPECT_EQ(words.size(), 64u);
    std::sort(words.begin(), words.end());
    EXPECT_EQ(std::unique(words.begin(), words.end()), words.end());
  }
  EXPECT_NE(vocabulary_hash(visual_vocabulary(), PlaceMode::kMajority),
            vocabulary_hash(thermal_vocabulary(), PlaceMode::kMajority));
}

TEST(Vocabulary, HashChangesWithAnyBitAndWithTheMode) {
  Vocabulary vocabulary{random_descriptors(8, 1)};
  const std::uint64_t hash = vocabulary_hash(vocabulary, PlaceMode::kMajority);
  EXPECT_EQ(hash, vocabulary_hash(vocabulary, PlaceMode::kMajority));
  EXPECT_NE(hash, vocabulary_hash(vocabulary, PlaceMode::kPaper));
  const std::uint64_t compact = vocabulary_hash(vocabulary, PlaceMode::kCompact);
  EXPECT_NE(hash, compact);
  vocabulary.words[7][31] ^= 0x80;
  EXPECT_NE(hash, vocabulary_hash(vocabulary, PlaceMode::kMajority));
  EXPECT_EQ(compact, vocabulary_hash(vocabulary, PlaceMode::kCompact)) << "it has no words";
}

TEST(DescribePlace, OrKeepsEveryResidualBitAndMajorityTheCommonOnes) {
  const Vocabulary vocabulary{{filled(0x00), filled(0xff)}};
  BinaryDescriptor a = filled(0x00), b = filled(0x00), c = filled(0x00);
  a[0] = 0b0011;
  b[0] = 0b0110;
  c[0] = 0b1000;
  const PlaceDescriptor paper = describe_place(vocabulary, PlaceMode::kPaper, {a, b, c});
  const PlaceDescriptor majority = describe_place(vocabulary, PlaceMode::kMajority, {a, b, c});
  ASSERT_EQ(paper.size(), 64u);
  ASSERT_EQ(majority.size(), 64u);
  EXPECT_EQ(paper[0], 0b1111);
  EXPECT_EQ(majority[0], 0b0010);
  EXPECT_TRUE(std::all_of(paper.begin() + 1, paper.end(), [](int byte) { return byte == 0; }));
  EXPECT_TRUE(
      std::all_of(majority.begin() + 1, majority.end(), [](int byte) { return byte == 0; }));
}

TEST(DescribePlace, WordThatIsMetExactlyIsNotTakenForEmpty) {
  const Vocabulary vocabulary{{filled(0x00), filled(0xff)}};
  const PlaceDescriptor place =
      describe_place(vocabulary, PlaceMode::kMajority, {vocabulary.words[1]});
  EXPECT_EQ(place[0], 0);
  EXPECT_NE(place[32], 0);
}

TEST(PlaceScore, PaperIsTheShareOfCommonBits) {
  PlaceDescriptor a(64, 0), b(64, 0);
  a[3] = 0b1111;
  b[3] = 0b0110;
  b[40] = 0xff;
  EXPECT_DOUBLE_EQ(place_score(PlaceMode::kPaper, a, b), 2.0 / 512);
}

TEST(PlaceScore, MajorityIsOneForTheSamePlaceAndIgnoresWordsThatAreEmptyInBoth) {
  const Vocabulary vocabulary{random_descriptors(64, 1)};
  const PlaceDescriptor place =
      describe_place(vocabulary, PlaceMode::kMajority, random_descriptors(10, 2));
  EXPECT_DOUBLE_EQ(place_score(PlaceMode::kMajority, place, place), 1.0);
}

TEST(PlaceScore, OfPlacesWithoutFeaturesIsZero) {
  const Vocabulary vocabulary{random_descriptors(4, 1)};
  for (const PlaceMode mode : {PlaceMode::kPaper, PlaceMode::kMajority, PlaceMode::kCompact}) {
    const PlaceDescriptor nothing = describe_place(vocabulary, mode, {});
    const PlaceDescriptor something = describe_place(vocabulary, mode, random_descriptors(9, 2));
    EXPECT_EQ(place_score(mode, nothing, nothing), 0);
    EXPECT_EQ(place_score(mode, nothing, something), 0);
    EXPECT_EQ(place_score(mode, something, nothing), 0);
  }
}

TEST(PlaceSize, IsWhatDescribePlaceGives) {
  const Vocabulary vocabulary{random_descriptors(64, 1)};
  for (const PlaceMode mode : {PlaceMode::kPaper, PlaceMode::kMajority, PlaceMode::kCompact}) {
    for (const int features : {1, 30, 150, 400}) {
      const std::size_t size =
          describe_place(vocabulary, mode, random_descriptors(features, 3)).size();
      EXPECT_TRUE(is_place_size(vocabulary, mode, size)) << size;
    }
    for (const std::size_t wrong : {0u, 1u, 7u, 33u, 2047u, 2049u, 2056u, 100000u}) {
      EXPECT_FALSE(is_place_size(vocabulary, mode, wrong)) << wrong;
    }
  }
}

TEST(CompactPlace, CountsCornersThatAreEachOthersBestMatch) {
  std::mt19937 random(5);
  const Descriptors features = random_descriptors(40, 8);
  Descriptors again = random_descriptors(30, 9);
  for (int i = 0; i < 10; ++i) again.push_back(with_noise(features[3 * i], 15, random));
  const auto place = [](const Descriptors& corners) {
    return describe_place({}, PlaceMode::kCompact, corners);
  };
  const auto score = [&](const Descriptors& a, const Descriptors& b) {
    return place_score(PlaceMode::kCompact, place(a), place(b));
  };
  EXPECT_GT(score(features, again), 0.5 * 10.0 / 40);
  EXPECT_LT(score(features, again), 11.0 / 40);
  EXPECT_EQ(score(features, again), score(again, features));
  EXPECT_LE(score(features, random_descriptors(40, 10)), 1.0 / 40);
  EXPECT_EQ(score(features, features), 1.0);
}

TEST(CompactPlace, CornersCountLessTheMoreBitsDifferAndTheLessTheyStandOut) {
  const auto place = [](const Descriptors& corners) {
    return describe_place({}, PlaceMode::kCompact, corners);
  };
  const auto differing = [](int bits) {
    BinaryDescriptor descriptor{};
    for (int bit = 0; bit < bits; ++bit) descriptor[0] |= static_cast<std::uint8_t>(1 << bit);
    return descriptor;
  };
  const auto score = [&](int bits, int bits_of_next) {
    return place_score(PlaceMode::kCompact, place({differing(0)}),
                       place({differing(bits), differing(bits_of_next)}));
  };
  EXPECT_EQ(score(0, 8), 0.5) << "one of two corners";
  EXPECT_LT(score(2, 8), score(1, 8));
  EXPECT_LT(score(2, 4), score(2, 8));
  EXPECT_EQ(score(4, 4), 0);
}

TEST(CompactPlace, FitsIntoOnePacket) {
  EXPECT_EQ(describe_place({}, PlaceMode::kCompact, random_descriptors(500, 1)).size(), 1200u);
}

// 12 places of 60 features; a second view sees 70 % of them, with noisy bits, and 18 others.
TEST(PlaceScore, MajorityFindsEachOfTwelvePlacesAgain) {
  std::mt19937 random(7);
  const Vocabulary vocabulary =
      train_vocabulary(random_descriptors(1500, 5), {64, 20, 1, 1}).vocabulary;
  std::vector<PlaceDescriptor> first, second;
  for (unsigned place = 0; place < 12; ++place) {
    const Descriptors features = random_descriptors(60, 100 + place);
    Descriptors again = random_descriptors(18, 200 + place);
    for (int i = 0; i < 42; ++i) again.push_back(with_noise(features[i], 12, random));
    first.push_back(describe_place(vocabulary, PlaceMode::kMajority, features));
    second.push_back(describe_place(vocabulary, PlaceMode::kMajority, again));
  }
  for (std::size_t i = 0; i < first.size(); ++i) {
    for (std::size_t j = 0; j < second.size(); ++j) {
      const double score = place_score(PlaceMode::kMajority, first[i], second[j]);
      if (i == j) {
        EXPECT_GT(score, 0.3);
      } else {
        EXPECT_LT(score, 0.2);
      }
    }
  }
}

TEST(VocabularyTraining, FindsTheCentresOfWellSeparatedClusters) {
  std::mt19937 random(11);
  Descriptors centres = random_descriptors(8, 4), descriptors;
  for (int i = 0; i < 400; ++i) descriptors.push_back(with_noise(centres[i % 8], 20, random));
  const TrainedVocabulary trained = train_vocabulary(descriptors, {8, 50, 5, 3});
  EXPECT_TRUE(trained.converged);
  EXPECT_LT(trained.mean_distance_bits, 20);
  Descriptors words = trained.vocabulary.words;
  std::sort(words.begin(), words.end());
  std::sort(centres.begin(), centres.end());
  EXPECT_TRUE(words == centres);
}

TEST(VocabularyTraining, SameSeedSameWordsOtherSeedOtherOrder) {
  const Descriptors descriptors = random_descriptors(300, 6);
  const auto words = [&](std::uint64_t seed) {
    return train_vocabulary(descriptors, {16, 10, 1, seed}).vocabulary.words;
  };
  EXPECT_TRUE(words(1) == words(1));
  EXPECT_TRUE(words(1) != words(2));
}

TEST(VocabularyTraining, RefusesTooFewDifferentDescriptors) {
  const Descriptors copies(100, filled(0x5a));
  EXPECT_THROW((void)train_vocabulary(copies, {2, 10, 1, 1}), std::runtime_error);
  EXPECT_THROW((void)train_vocabulary({}, {1, 10, 1, 1}), std::runtime_error);
  EXPECT_THROW((void)train_vocabulary(copies, {0, 10, 1, 1}), std::runtime_error);
}

}  // namespace
}  // namespace covey
